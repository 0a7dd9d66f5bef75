import { describe, expect, it } from "vitest";
import {
  apply,
  axesOf,
  eulerOf,
  fromEnu,
  FRAMES,
  headingOf,
  horizonOf,
  IDENTITY,
  inEnu,
  type Matrix,
  matrixOfEuler,
  matrixOfQuaternion,
  metresFrom,
  pitchSign,
  project,
} from "./maths";

const near = (a: readonly number[], b: readonly number[], eps = 1e-9): void => {
  expect(a.length).toBe(b.length);
  a.forEach((value, i) => expect(Math.abs(value - (b[i] ?? Number.NaN))).toBeLessThan(eps));
};
const euler = (r: number, p: number, y: number): Matrix => matrixOfEuler(r, p, y) ?? IDENTITY;

describe("rotations", () => {
  it("turns x onto y for +90° about z, from Euler angles and from a quaternion alike", () => {
    near(apply(euler(0, 0, 90), [1, 0, 0]), [0, 1, 0]);
    const h = Math.SQRT1_2;
    near(matrixOfQuaternion(h, 0, 0, h) ?? [], euler(0, 0, 90));
    near(matrixOfQuaternion(h, h, 0, 0) ?? [], euler(90, 0, 0));
    near(matrixOfQuaternion(2 * h, 0, 2 * h, 0) ?? [], euler(0, 90, 0));
  });
  it("gives nothing for what is no rotation", () => {
    expect(matrixOfQuaternion(0, 0, 0, 0)).toBeUndefined();
    expect(matrixOfQuaternion(Number.NaN, 0, 0, 1)).toBeUndefined();
    expect(matrixOfEuler(Number.NaN, 0, 0)).toBeUndefined();
  });
});

describe("the horizon shows the truth", () => {
  it("nose: positive pitch is nose down in ENU and NWU, nose up in NED", () => {
    expect(horizonOf(inEnu(euler(0, 10, 0), "ENU"), "ENU").nose).toBeCloseTo(-10);
    expect(horizonOf(inEnu(euler(0, 10, 0), "NWU"), "NWU").nose).toBeCloseTo(-10);
    expect(horizonOf(inEnu(euler(0, 10, 0), "NED"), "NED").nose).toBeCloseTo(10);
    expect(FRAMES.map(pitchSign)).toEqual(["+ nose down", "+ nose up", "+ nose down"]);
  });
  it("bank: positive roll is right side down in every frame", () => {
    for (const frame of FRAMES) {
      const { nose, bank } = horizonOf(inEnu(euler(20, 0, 123), frame), frame);
      expect(bank).toBeCloseTo(20);
      expect(nose).toBeCloseTo(0);
    }
  });
  it("level is level, whatever the heading", () => {
    for (const frame of FRAMES) {
      for (const yaw of [-170, -90, 0, 45, 180]) {
        const { nose, bank } = horizonOf(inEnu(euler(0, 0, yaw), frame), frame);
        near([nose, bank], [0, 0], 1e-9);
      }
    }
  });
});

describe("heading", () => {
  it("is clockwise from north in every frame", () => {
    expect(headingOf(inEnu(euler(0, 0, 0), "ENU"))).toBeCloseTo(90); // x east
    expect(headingOf(inEnu(euler(0, 0, 90), "ENU"))).toBeCloseTo(0); // x north
    expect(headingOf(inEnu(euler(0, 0, 30), "NED"))).toBeCloseTo(30);
    expect(headingOf(inEnu(euler(0, 0, 30), "NWU"))).toBeCloseTo(330);
  });
  it("is not invented while x points straight up", () => {
    expect(headingOf(inEnu(euler(0, -90, 0), "ENU"))).toBeUndefined();
  });
});

describe("the world", () => {
  it("names the frame's axes by where they point", () => {
    for (const frame of FRAMES) {
      const axes = axesOf(frame);
      expect(axes.map((axis) => axis.letter).join("")).toBe(frame);
      axes.forEach((axis, i) => {
        const unit: [number, number, number] = [0, 0, 0];
        unit[i] = 1;
        near(apply(inEnu(IDENTITY, frame), unit), axis.to);
      });
    }
  });
  it("draws up as up, and what is farther as higher from above", () => {
    const camera = { azimuth: 0.6, elevation: 0.46 };
    near(project(camera, [0, 0, 0]), [0, 0, 0]);
    expect(project(camera, [0, 0, 1])[1]).toBeGreaterThan(0);
    expect(project({ azimuth: 0, elevation: 0.46 }, [0, 1, 0])[1]).toBeGreaterThan(0);
    expect(project({ azimuth: 0, elevation: 0.46 }, [0, 1, 0])[2]).toBeGreaterThan(0);
  });
  it("measures a track in metres, over the date line too", () => {
    near(metresFrom([52, 6], 52.001, 6), [0, 111.31949], 1e-3);
    const [east] = metresFrom([0, 179.9999], 0, -179.9999);
    expect(east).toBeCloseTo(22.26, 1);
  });
});

describe("another frame's numbers", () => {
  it("fromEnu undoes inEnu", () => {
    for (const frame of FRAMES) near(fromEnu(inEnu(euler(10, 20, 30), frame), frame), euler(10, 20, 30));
  });
  it("reads back what was written, and keeps the horizon where it is", () => {
    for (const angles of [[10, 20, 30], [-170, -80, 179], [0, 0, -90]] as readonly [number, number, number][]) {
      const { roll, pitch, yaw } = eulerOf(euler(...angles));
      near([roll, pitch, yaw], angles, 1e-9);
    }
    const enu = euler(5, 10, 40);
    const ned = eulerOf(fromEnu(enu, "NED"));
    expect(ned.yaw).toBeCloseTo(50);
    expect(ned.pitch).toBeCloseTo(-10); // nose down, in both
    expect(Math.abs(ned.roll)).toBeCloseTo(175); // z of the sensor points up, which NED calls upside down
  });
});
