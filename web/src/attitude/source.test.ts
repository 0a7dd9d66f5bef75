import { describe, expect, it } from "vitest";
import { eulerOfMatrix, type Matrix3 } from "../data/rotations";
import type { Channel } from "../data/channels";
import type { ChannelInfo } from "../wire/types";
import { attitudeSource } from "./source";

function channel(id: number, kind: ChannelInfo["kind"], frame: string, sample: readonly number[], group = ""): Channel {
  const ring = { length: 1, value: (column: number) => sample[column] ?? Number.NaN, time: () => 0, indexAt: () => 0 };
  const columns = [{ unit: kind === "vector" ? "m" : "" }];
  return {
    info: { id, kind, frame, name: kind, title: kind, group, message: group, columns },
    ring,
  } as unknown as Channel;
}
const quaternion = channel(3, "quaternion", "NED from body", [Math.SQRT1_2, 0, 0, Math.SQRT1_2]);
const matrix = channel(4, "matrix", "NWU from body", [1, 0, 0, 0, 1, 0, 0, 0, 1]);
const derived = channel(-4, "euler", "NWU from body", [1, 2, 3]);
const euler = channel(5, "euler", "", [1, 2, 3]);

describe("sourceOf", () => {
  it("prefers the quaternion, and reports it", () => {
    const source = attitudeSource([derived, matrix, euler, quaternion]);
    expect(source).toMatchObject({ words: "from quaternion", frame: "NED" });
    const m: Matrix3 | undefined = source?.at(0);
    expect(m && eulerOfMatrix(m)[2]).toBeCloseTo(90);
    expect(attitudeSource([channel(1, "quaternion", "", [0, 0, 0, 0])])?.at(0)).toBeUndefined();
  });
  it("reads a matrix through its derived angles, and angles directly", () => {
    expect(attitudeSource([matrix, derived])).toMatchObject({
      words: "from rotation matrix",
      frame: "NWU",
      channel: derived,
    });
    expect(attitudeSource([euler])).toMatchObject({ words: "from Euler angles", frame: "ENU" });
  });
  it("makes an attitude against the earth level, with the position beside it", () => {
    // At Greenwich on the equator, nose up the pole and right wing east: level, heading north. Body x is earth's z, y is y, z is −x.
    const earth = channel(7, "quaternion", "ECEF from body", [Math.SQRT1_2, 0, -Math.SQRT1_2, 0], "INS 4");
    const place = channel(8, "vector", "ECEF", [6_378_137, 0, 0], "INS 4");
    const source = attitudeSource([earth, place]);
    expect(source).toMatchObject({ words: "from INS 4", frame: "NED", detail: "INS 4, quaternion, ECEF from body" });
    const m = source?.at(0);
    expect(m && eulerOfMatrix(m).map((angle) => Math.abs(Math.round(angle)))).toEqual([0, 0, 0]);
    expect(attitudeSource([earth])).toBeUndefined();
    expect(attitudeSource([earth, place, euler])).toMatchObject({ channel: euler });
  });
  it("has no attitude if none is sent", () => {
    expect(attitudeSource([])).toBeUndefined();
  });
});
