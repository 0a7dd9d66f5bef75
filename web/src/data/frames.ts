/**
 * The frame of reference: one choice applies to world and body together, and to every quantity with axes.
 *
 *     ENU   x east    y north   z up      with a body whose axes are FLU: x forward, y left,  z up
 *     NWU   x north   y west    z up      with FLU
 *     NED   x north   y east    z down    with FRD:                       x forward, y right, z down
 *
 * A level sensor reads roll 0 and pitch 0 in each of them. Changing the world alone would not work: an FRD body under an ENU world
 * lies on its back, and reads roll 180° beside a level horizon.
 *
 * Every change is linear, out[c] = Σ factor · in[column] + offset (an angle wraps): components swap places and signs, elements of
 * a quaternion mix (q' = w ⊗ q ⊗ b), angles change sign and reference direction. So rings are changed in place, least and
 * greatest stay bounds, and means follow.
 */
import type { ChannelInfo } from "../wire/types";
import {
  BETWEEN,
  type Matrix3,
  matrixIn,
  multiply,
  type Quaternion,
  type Vector3,
  vectorIn,
  type WorldFrame,
} from "./rotations";

export type BodyFrame = "FLU" | "FRD";

/** One column after the change, as a sum of columns. */
export interface MatrixRow {
  readonly terms: readonly (readonly [column: number, factor: number])[];
  readonly offset: number;
}
/** One row for each column that changes, in order; columns after them stay. */
export type FrameChange = readonly MatrixRow[];

const WORLDS: readonly WorldFrame[] = ["ENU", "NED", "NWU"];
/** Half a turn about x: FLU in the axes of FRD, and back. */
const OVER: Quaternion = [0, 1, 0, 0];

export const bodyOf = (world: WorldFrame): BodyFrame => (world === "NED" ? "FRD" : "FLU");

/** The world frame of a channel's numbers: of a rotation, of angles, of a vector along the world's axes. */
export function worldOf({ frame }: Pick<ChannelInfo, "frame">): WorldFrame | undefined {
  return WORLDS.find((world) => frame === world || frame.startsWith(`${world} `));
}

/** Units of quantities along the sensor's own axes, for devices that do not name these. */
const FELT = new Set(["m/s²", "g", "°/s", "rad/s", "a.u.", "µT", "G", "gauss"]);

/** Whether it is a vector along the body axes. */
export function isBodily({
  kind,
  frame,
  unit,
  columns,
}: Pick<ChannelInfo, "kind" | "frame" | "unit" | "columns">): boolean {
  if (kind !== "vector" || !isXyz(columns)) return false;
  return frame === "body" || frame === "sensor" || (frame === "" && FELT.has(unit || (columns[0]?.unit ?? "")));
}

function isXyz(columns: ChannelInfo["columns"]): boolean {
  return (["x", "y", "z"] as const).every((axis, c) => columns[c]?.axis === axis);
}

/** A rotation with both its frames changed. */
export function pairIn(m: Matrix3, from: WorldFrame, to: WorldFrame): Matrix3 {
  const w = matrixIn(m, from, to);
  if (bodyOf(from) === bodyOf(to)) return w;
  return [w[0], -w[1], -w[2], w[3], -w[4], -w[5], w[6], -w[7], -w[8]];
}

/** The linear map of n columns, from what it makes of each unit vector. */
function linear(n: number, map: (v: readonly number[]) => readonly number[]): FrameChange {
  const images = Array.from({ length: n }, (_, c) => map(Array.from({ length: n }, (_, k) => Number(k === c))));
  return Array.from({ length: n }, (_, row) => ({
    offset: 0,
    terms: images.flatMap((image, c): (readonly [number, number])[] =>
      Math.abs(image[row]!) > 1e-12 ? [[c, image[row]!]] : [],
    ),
  }));
}

/** ZYX angles: NED (r, p, y) is NWU (r, −p, −y) and ENU (r, −p, 90 − y). */
function anglesChange(from: WorldFrame, to: WorldFrame): FrameChange {
  const over = bodyOf(from) === bodyOf(to) ? 1 : -1;
  const north: Readonly<Record<WorldFrame, number>> = { ENU: 90, NED: 0, NWU: 0 }; // yaw of a body that points north
  return [
    { terms: [[0, 1]], offset: 0 },
    { terms: [[1, over]], offset: 0 },
    { terms: [[2, over]], offset: north[to] - over * north[from] },
  ];
}

/** The change of a channel's columns from one frame to the other; undefined if nothing changes. */
export function frameChange(
  info: Pick<ChannelInfo, "kind" | "frame" | "unit" | "columns">,
  from: WorldFrame,
  to: WorldFrame,
): FrameChange | undefined {
  if (from === to) return undefined;
  const turned = bodyOf(from) !== bodyOf(to);
  if (isBodily(info)) return turned ? linear(3, ([x, y, z]) => [x!, -y!, -z!]) : undefined;
  if (worldOf(info) === undefined) return undefined;
  switch (info.kind) {
    case "vector":
      return isXyz(info.columns) ? linear(3, (v) => vectorIn(v as unknown as Vector3, from, to)) : undefined;
    case "euler":
      return anglesChange(from, to);
    case "quaternion":
      return linear(4, (q) =>
        turned
          ? multiply(multiply(BETWEEN[from][to], q as unknown as Quaternion), OVER)
          : multiply(BETWEEN[from][to], q as unknown as Quaternion),
      );
    case "matrix":
      return linear(9, (m) => pairIn(m as unknown as Matrix3, from, to));
    default:
      return undefined;
  }
}

const WORDS: Readonly<Record<WorldFrame, readonly string[]>> = {
  ENU: ["east", "north", "up"],
  NED: ["north", "east", "down"],
  NWU: ["north", "west", "up"],
};
const DIRECTIONS = new Set(Object.values(WORDS).flat());

/** The channel as named in a frame: axes named after directions get that frame's names. Keys stay. */
export function infoIn(info: ChannelInfo, from: WorldFrame, to: WorldFrame): ChannelInfo {
  if (from === to) return info;
  if (isBodily(info)) return { ...info, frame: bodyOf(to) };
  const world = worldOf(info);
  if (world === undefined || frameChange(info, from, to) === undefined) return info;
  const columns = info.columns.map((column, c) => {
    const own = (column.label || column.name).toLowerCase();
    const word = WORDS[to][c];
    if (info.kind !== "vector" || word === undefined) return column;
    if (DIRECTIONS.has(own)) return { ...column, label: word };
    return /^[enudw]$/.test(own) ? { ...column, label: word.charAt(0).toUpperCase() } : column;
  });
  return { ...info, columns, frame: info.frame.replace(world, to) };
}

/** The values of one column of a row after a change. `period`: it wraps there; 0: never. */
export function inFrame({ terms, offset }: MatrixRow, of: (column: number) => number, period: number): number {
  let sum = offset;
  for (const [column, factor] of terms) sum += factor * of(column);
  if (!(period > 0) || offset === 0) return sum;
  return sum > period / 2 ? sum - period : sum <= -period / 2 ? sum + period : sum;
}
