import { expect, it } from "vitest";
import { eulerOfMatrix, matrixOfQuaternion, type Vector3 } from "../data/rotations";
import { field } from "../testing/fixtures";
import { elementsOf, hasAngles, isUpsideDown, quaternionOf, type Turn, turnedOver, turnOf } from "./alignment";

const ALL: readonly Vector3[] = [
  [0, 0, 0],
  [180, 0, 0],
  [10, -20, 30],
  [-170, 60, -135],
  [0, 0, 180],
];

it.each(ALL)("finds the angles %d, %d, %d again in their quaternion", (...angles) => {
  const elements = elementsOf(angles, 4);
  expect(elements[0]).toBeGreaterThanOrEqual(0);
  const differences = turnOf(elements)?.angles.map((angle, i) => angle - (angles[i] ?? NaN)) ?? [];
  for (const one of differences) expect(Math.cos((one * Math.PI) / 180)).toBeCloseTo(1, 12);
});

it("turns the sensor over about its x axis, and back", () => {
  for (const angles of ALL) {
    for (const count of [3, 4]) {
      const stored = (of: Vector3) => turnOf(elementsOf(of, count)) as Turn;
      const turn = stored(angles);
      const over = stored(turnedOver(turn.angles));
      expect(isUpsideDown(over)).toBe(!isUpsideDown(turn));
      stored(turnedOver(over.angles)).matrix.forEach((one, i) => {
        expect(one).toBeCloseTo(turn.matrix[i] ?? NaN, 12);
      });
    }
  }
  expect(elementsOf(turnedOver([0, 0, 0]), 4)).toEqual([0, 1, 0, 0]);
});

it("takes angles as the turn of the axes, a quaternion as that of a vector", () => {
  const [w, x, y, z] = elementsOf([0, 0, 90], 4) as unknown as [number, number, number, number];
  expect(turnOf([0, 0, -90])?.matrix[3]).toBeCloseTo(1);
  expect(eulerOfMatrix(matrixOfQuaternion([w, x, y, z]))[2]).toBeCloseTo(90);
});

it("has no turn of what is no rotation, or was not read", () => {
  expect(turnOf([0.5, 0, 0, 0])).toBeUndefined();
  expect(turnOf([1, 0, 0, undefined])).toBeUndefined();
});

it("knows alignments by their frames", () => {
  const elements = ["a", "b", "c", "d"].map((name) => field({ name, frame: "aligned from native" }));
  expect(quaternionOf([field(), ...elements])).toEqual(elements);
  expect(quaternionOf([field({ frame: "ENU" })])).toEqual([]);
  const angles = field({ editor: "vector", axes: ["roll", "pitch", "yaw"], frame: "output from sensor" });
  expect([hasAngles(angles), hasAngles({ ...angles, frame: "" })]).toEqual([true, false]);
});
