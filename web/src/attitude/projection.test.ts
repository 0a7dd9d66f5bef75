import { describe, expect, it } from "vitest";
import { eulerOfMatrix, matrixIn, matrixOfEuler, type Matrix3, type WorldFrame } from "../data/rotations";
import { apply, axesOf, FRAMES, headingOf, horizonOf, metresFrom, pitchSign, project } from "./projection";

const IDENTITY: Matrix3 = [1, 0, 0, 0, 1, 0, 0, 0, 1];
const inEnu = (m: Matrix3, frame: WorldFrame): Matrix3 => matrixIn(m, frame, "ENU");
const near = (a: readonly number[], b: readonly number[], eps = 1e-9): void => {
  expect(a.length).toBe(b.length);
  a.forEach((value, i) => expect(Math.abs(value - (b[i] ?? Number.NaN))).toBeLessThan(eps));
};
const euler = (r: number, p: number, y: number): Matrix3 => matrixOfEuler([r, p, y]);

describe("the horizon has the correct pitch and roll", () => {
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
  it("is absent while x points straight up", () => {
    expect(headingOf(inEnu(euler(0, -90, 0), "ENU"))).toBeUndefined();
  });
});

describe("the world", () => {
  it("names the frame's axes by their direction", () => {
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
  it("draws up upwards, and farther points higher when seen from above", () => {
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

describe("numbers in another frame", () => {
  it("do not change horizon and heading", () => {
    const enu = euler(5, 10, 40);
    const [roll, pitch, yaw] = eulerOfMatrix(matrixIn(enu, "ENU", "NED"));
    expect(yaw).toBeCloseTo(50);
    expect(pitch).toBeCloseTo(-10); // nose down, in both
    expect(Math.abs(roll)).toBeCloseTo(175); // z of the sensor points up, which is upside down in NED
    const back = inEnu(euler(roll, pitch, yaw), "NED");
    near(back, enu);
    expect(horizonOf(back, "ENU").nose).toBeCloseTo(-10);
    expect(headingOf(back)).toBeCloseTo(50);
  });
});
