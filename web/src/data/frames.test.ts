import { describe, expect, it } from "vitest";
import { channelInfo, columnInfo } from "../testing/fixtures";
import type { ChannelInfo, ColumnInfo } from "../wire/types";
import {
  eulerOfMatrix,
  type Matrix3,
  matrixOfEuler,
  matrixOfQuaternion,
  type Quaternion,
  type Vector3,
  vectorIn,
  type WorldFrame,
} from "./rotations";
import { type FrameChange, frameChange, infoIn, pairIn, inFrame } from "./frames";

const WORLDS: readonly WorldFrame[] = ["ENU", "NED", "NWU"];
const pairs = WORLDS.flatMap((from) => WORLDS.map((to) => [from, to] as const));

const info = (
  kind: ChannelInfo["kind"],
  frame: string,
  axes: readonly string[],
  unit = "",
  names = axes,
): ChannelInfo =>
  channelInfo({
    ...{ message: "M", title: "T", kind, unit, frame },
    columns: names.map((name, c) =>
      columnInfo({ name, dtype: "f8", unit, axis: axes[c] as ColumnInfo["axis"], period: kind === "euler" ? 360 : 0 }),
    ),
  });

const apply = (change: FrameChange | undefined, values: readonly number[], period = 0): number[] =>
  change === undefined ? [...values] : change.map((row) => inFrame(row, (c) => values[c]!, period));

/** m v. */
const times = (m: Matrix3, [x, y, z]: Vector3): Vector3 => [
  m[0] * x + m[1] * y + m[2] * z,
  m[3] * x + m[4] * y + m[5] * z,
  m[6] * x + m[7] * y + m[8] * z,
];
const close = (a: readonly number[], b: readonly number[], digits = 9): void =>
  a.forEach((v, k) => expect(v).toBeCloseTo(b[k]!, digits));

describe("a choice of frame", () => {
  it("rotates attitude and body vectors consistently", () => {
    for (const [from, to] of pairs) {
      const angles: Vector3 = [11, -23, 77];
      const m = matrixOfEuler(angles);
      const felt: Vector3 = [0.3, -1.2, 9.5];
      const world = times(m, felt);
      const shown = times(
        pairIn(m, from, to),
        apply(frameChange(info("vector", "body", ["x", "y", "z"], "m/s²"), from, to), felt) as unknown as Vector3,
      );
      close(shown, vectorIn(world, from, to));
      close(shown, apply(frameChange(info("vector", from, ["x", "y", "z"], "m/s"), from, to), world));
    }
  });

  it("changes angles, quaternions and matrices alike", () => {
    for (const [from, to] of pairs) {
      for (const angles of [
        [11, -23, 77],
        [-170, 40, -100],
        [179, -60, 179],
      ] as const) {
        const wanted = pairIn(matrixOfEuler(angles), from, to);
        close(
          eulerOfMatrix(wanted),
          apply(frameChange(info("euler", from, ["x", "y", "z"]), from, to), angles, 360),
          6,
        );
        const q: Quaternion = [0.5, -0.5, 0.7, 0.1];
        const turned = apply(
          frameChange(info("quaternion", `${from} from body`, ["w", "x", "y", "z"]), from, to),
          q,
        ) as unknown as Quaternion;
        close(matrixOfQuaternion(turned), pairIn(matrixOfQuaternion(q), from, to));
        close(
          apply(frameChange(info("matrix", `${from} from body`, [..."abcdefghi"]), from, to), matrixOfEuler(angles)),
          wanted,
        );
      }
    }
  });

  it("a level device is level in every frame", () => {
    for (const [from, to] of pairs)
      close(eulerOfMatrix(pairIn(matrixOfEuler([0, 0, 30]), from, to)).slice(0, 2), [0, 0]);
  });

  it("is reversed exactly if components only swap", () => {
    const body = info("vector", "", ["x", "y", "z"], "°/s");
    const values = [0.1, 0.2, 0.3];
    expect(apply(frameChange(body, "NED", "ENU"), apply(frameChange(body, "ENU", "NED"), values))).toEqual(values);
    expect(frameChange(body, "ENU", "NWU")).toBeUndefined(); // the body is FLU in both
  });

  it("does not change quantities without such axes", () => {
    expect(frameChange(info("vector", "ECEF", ["x", "y", "z"], "m"), "ENU", "NED")).toBeUndefined();
    expect(frameChange(info("quaternion", "ECEF from body", ["w", "x", "y", "z"]), "ENU", "NED")).toBeUndefined();
    expect(frameChange(info("scalar", "", [""], "°"), "ENU", "NED")).toBeUndefined();
  });

  it("is shown in the names of axes and of the frame", () => {
    const local = infoIn(info("vector", "NED", ["x", "y", "z"], "m", ["north", "east", "down"]), "NED", "ENU");
    expect(local.frame).toBe("ENU");
    expect(local.columns.map(({ label }) => label)).toEqual(["east", "north", "up"]);
    expect(local.columns.map(({ name }) => name)).toEqual(["north", "east", "down"]); // keys of links and hidden series
    expect(infoIn(info("vector", "body", ["x", "y", "z"], "m/s²"), "NED", "ENU").frame).toBe("FLU");
    expect(infoIn(info("quaternion", "NED from body", ["w", "x", "y", "z"]), "NED", "ENU").frame).toBe("ENU from body");
  });
});
