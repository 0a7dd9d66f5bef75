import { describe, expect, it, test } from "vitest";
import euler from "../../../tests/golden/euler.json";
import orientation from "../../../tests/golden/xbus/orientation.json";
import {
  BETWEEN,
  normBounds,
  eulerColumns,
  eulerOfMatrix,
  matrixIn,
  matrixOfEuler,
  matrixOfQuaternion,
  multiply,
  normColumn,
  vectorIn,
  type Matrix3,
  type Quaternion,
  type Vector3,
  type WorldFrame,
} from "./rotations";

interface Conversion {
  readonly what: string;
  readonly input: "quaternion" | "matrix" | "euler" | "vector";
  readonly frame: WorldFrame;
  readonly values: readonly number[];
  readonly to?: WorldFrame;
  readonly expected?: readonly number[];
  readonly euler?: Vector3;
  readonly matrix?: readonly number[];
}

const all = orientation.conversions as unknown as readonly Conversion[];
const conversions = all.filter(({ to }) => to !== undefined);
const orientations = all.filter(({ euler }) => euler !== undefined);

/** A matrix row by row, as it is sent. */
const rows = (w: readonly number[]): Matrix3 => [w[0]!, w[3]!, w[6]!, w[1]!, w[4]!, w[7]!, w[2]!, w[5]!, w[8]!];
const close = (found: readonly number[], wanted: readonly number[], digits = 9): void =>
  wanted.forEach((v, k) => expect(found[k]).toBeCloseTo(v, digits));
/** A rotation and its quaternion; q and −q are equivalent. */
const sign = (q: readonly number[], like: readonly number[]): number =>
  Math.sign(q.reduce((sum, v, k) => sum + v * like[k]!, 0)) || 1;
const isRotation = (m: Matrix3): boolean =>
  Math.abs(m[0] * m[0] + m[3] * m[3] + m[6] * m[6] - 1) < 1e-9 &&
  Math.abs(m[0] * m[1] + m[3] * m[4] + m[6] * m[7]) < 1e-9;

/** q_from_body, written as `to` from body. */
const quaternionIn = (q: Quaternion, from: WorldFrame, to: WorldFrame): Quaternion => multiply(BETWEEN[from][to], q);

describe("the vendor's own conversions between world frames", () => {
  test.each(conversions)("$what", ({ input, frame, to, values, expected }) => {
    if (to === undefined || expected === undefined) throw new Error("not a conversion");
    switch (input) {
      case "quaternion": {
        const found = quaternionIn(values as unknown as Quaternion, frame, to);
        return close(
          found.map((v) => v * sign(found, expected)),
          expected,
        );
      }
      case "vector":
        return close(vectorIn(values as unknown as Vector3, frame, to), expected, 12);
      case "euler": // compared as rotations: near ±90° of pitch many angles are one rotation
        return close(
          matrixIn(matrixOfEuler(values as unknown as Vector3), frame, to),
          matrixOfEuler(expected as unknown as Vector3),
          7,
        );
      case "matrix": {
        const m = rows(values);
        // The vendor's set 1 is not a rotation, so there is nothing to compare.
        if (!isRotation(m)) return expect(isRotation(rows(expected))).toBe(false);
        return close(matrixIn(m, frame, to), rows(expected));
      }
    }
  });
});

describe("the vendor's Euler angles and matrices", () => {
  test.each(orientations)("$what", ({ values, euler, matrix }) => {
    const m = matrixOfQuaternion(values as unknown as Quaternion);
    // The vendor does not normalise: a quaternion of norm 0.9998 gives a matrix scaled by its square.
    const square = values.reduce((sum, v) => sum + v * v, 0);
    close(
      m.map((v) => v * square),
      rows(matrix!),
      6,
    );
    const found = eulerOfMatrix(m);
    const unit = Math.abs(square - 1) < 1e-6;
    close(matrixOfEuler(found), matrixOfEuler(euler!), unit ? 6 : 3);
    if (Math.abs(euler![1]) < 89) close(found, euler!, unit ? 4 : 1);
  });
});

it("reads a matrix row by row, as the server sends it", () => {
  for (const { values, matrix } of orientations) {
    const byMatrix = eulerColumns(
      rows(matrix!).map((v) => [v]),
      1,
    ).map((column) => column[0]!);
    const byQuaternion = eulerColumns(
      values.map((v) => [v]),
      1,
    ).map((column) => column[0]!);
    close(matrixOfEuler(byMatrix as unknown as Vector3), matrixOfEuler(byQuaternion as unknown as Vector3), 3);
  }
});

it("converts between frames and back exactly", () => {
  const q: Quaternion = [0.5, -0.1, 0.7, 0.4999];
  const v: Vector3 = [1, 2, 3];
  for (const a of ["ENU", "NED", "NWU"] as const) {
    for (const b of ["ENU", "NED", "NWU"] as const) {
      const there = quaternionIn(q, a, b);
      const back = quaternionIn(there, b, a);
      close(
        back.map((x) => x * sign(back, q)),
        q,
        12,
      );
      expect(vectorIn(vectorIn(v, a, b), b, a)).toEqual(v);
      const m = matrixOfQuaternion(q);
      close(matrixIn(m, a, b), matrixOfQuaternion(there), 12);
    }
  }
});

it("gives NaN for a quaternion of norm 0", () => {
  expect(eulerColumns([[0], [0], [0], [0]], 1).map((column) => column[0])).toEqual([NaN, NaN, NaN]);
});

it("gives roll 0 at gimbal lock", () => {
  const up = eulerOfMatrix(matrixOfEuler([30, 90, 10]));
  expect(up[0]).toBe(0);
  close(matrixOfEuler(up), matrixOfEuler([30, 90, 10]), 6);
});

it("multiplies in the order of successive rotations", () => {
  const yaw: Quaternion = [Math.SQRT1_2, 0, 0, Math.SQRT1_2];
  const pitch: Quaternion = [Math.SQRT1_2, 0, Math.SQRT1_2, 0];
  close(eulerOfMatrix(matrixOfQuaternion(multiply(yaw, [Math.cos(0.1), Math.sin(0.1), 0, 0]))), [
    0.2 * (180 / Math.PI),
    0,
    90,
  ]);
  expect(Math.abs(eulerOfMatrix(matrixOfQuaternion(pitch))[1])).toBeCloseTo(90, 6);
});

it("takes the length of vectors", () => {
  expect([
    ...normColumn(
      [
        [3, 0, NaN],
        [4, 0, 1],
        [12, 0, 1],
      ],
      3,
    ),
  ]).toEqual([13, 0, NaN]);
});

it("bounds the lengths of vectors by their summarised components", () => {
  const pairs = [
    [-1, 2],
    [3, 4],
    [-2, -1],
  ];
  const [near, far] = normBounds(pairs, 2);
  expect(near).toBeCloseTo(Math.hypot(0, 3, 1), 5);
  expect(far).toBeCloseTo(Math.hypot(2, 4, 2), 5);
  expect(normBounds([[NaN, NaN]], 2)).toEqual(new Float32Array([NaN, NaN]));
});

test("one attitude has the angles that the server gives it, at a pitch of ±90° too", () => {
  expect(euler.rows.length).toBeGreaterThan(5);
  for (const { what, quaternion, euler: angles } of euler.rows) {
    const found = eulerColumns(
      quaternion.map((part) => [part]),
      1,
    ).map((column) => column[0] ?? Number.NaN);
    const off = found.map((angle, at) => Math.abs(((angle - (angles[at] ?? 0) + 540) % 360) - 180));
    expect(Math.max(...off), what).toBeLessThan(1e-4);
  }
});
