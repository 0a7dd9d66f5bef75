/**
 * Quantities that the page derives from a device's channels, frame by frame: a channel's frames go through its `Extension`, which
 * adds the norm as a further column and gives the frame of the derived channel.
 */
import type { Column, SampleFrame } from "../wire/codec";
import type { ChannelInfo, ColumnInfo } from "../wire/types";
import { type FrameChange, inFrame } from "./frames";
import { eulerColumns, normBounds, normColumn, type Numbers } from "./rotations";
import { TEXT } from "../texts/plots";

/** A position has no length worth showing: its distance from the middle of the earth. */
const NO_NORM = /position|ecef|latlon|latitude|coordinate/i;
const NORM_LETTERS: readonly (readonly [words: RegExp, letter: string])[] = [
  [/^(free )?acc/i, "|a|"],
  [/rate|gyr|angular/i, "|ω|"],
  [/mag/i, "|m|"],
  [/vel/i, "|v|"],
];

const PLAIN = { sent_unit: "", choices: {}, bits: [], doc: "" } as const;

function floats(column: ColumnInfo): boolean {
  return column.dtype === "f4" || column.dtype === "f8";
}

/** Columns whose norm is added to a channel: x, y and z of a vector; undefined when there is none to add. */
export function normOf(info: ChannelInfo): readonly number[] | undefined {
  if (info.kind !== "vector" || NO_NORM.test(info.name) || info.columns.some(({ name }) => name === "norm"))
    return undefined;
  const found = ["x", "y", "z"].map((axis) =>
    info.columns.findIndex((column) => column.axis === axis && floats(column)),
  );
  return found.every((c) => c >= 0) && info.columns.length === 3 ? found : undefined;
}

/** The channel as the page knows it: with its norm as a further column. */
export function withNorm(info: ChannelInfo): ChannelInfo {
  const [first] = normOf(info) ?? [];
  const like = first === undefined ? undefined : info.columns[first];
  if (like === undefined) return info;
  const label = NORM_LETTERS.find(([words]) => words.test(info.title || info.name))?.[1] ?? "| |";
  const norm: ColumnInfo = {
    ...PLAIN,
    name: "norm",
    dtype: "f4",
    unit: like.unit,
    label,
    axis: "",
    decimals: like.decimals,
    period: 0,
    doc: TEXT.normDoc,
  };
  return { ...info, columns: [...info.columns, norm] };
}

/**
 * Whether Euler angles can be computed from this channel. Roll and pitch are against the local level: for a rotation against the
 * earth's axes (ECEF) they need the position (attitude/source.ts).
 */
export function isRotation(info: ChannelInfo): boolean {
  if (info.frame.startsWith("ECEF")) return false;
  return (
    (info.kind === "quaternion" && info.columns.length === 4) || (info.kind === "matrix" && info.columns.length === 9)
  );
}

/** The channel of Euler angles computed from `source`; its id is negative because the wire does not know it. */
export function eulerInfo(source: ChannelInfo): ChannelInfo {
  const angle = (name: string, axis: "x" | "y" | "z", period: number, doc: string): ColumnInfo => ({
    ...PLAIN,
    name,
    dtype: "f8",
    unit: "°",
    label: name,
    axis,
    decimals: 2,
    period,
    doc,
  });
  return {
    id: -1 - source.id,
    device: source.device,
    message: source.message,
    name: "EulerAngles",
    title: TEXT.eulerAngles,
    kind: "euler",
    unit: "°",
    frame: source.frame,
    columns: [
      angle("roll", "x", 360, TEXT.rollDoc),
      angle("pitch", "y", 0, TEXT.pitchDoc),
      angle("yaw", "z", 360, TEXT.yawDoc),
    ],
    doc: TEXT.eulerAnglesDoc(source.title || source.name),
    source: source.source,
    group: source.group,
    verified: source.verified,
  };
}

/** A frame with the norm of `columns` added. `bounds`: rows are alternately the least and the greatest of an interval. */
export function addNorm(frame: SampleFrame, columns: readonly number[], bounds = false): SampleFrame {
  const parts = columns.map((c) => frame.columns[c] as Numbers & Column);
  return { ...frame, columns: [...frame.columns, (bounds ? normBounds : normColumn)(parts, frame.n)] };
}

/** A frame converted to another frame of reference; unchanged columns are the same arrays. */
export function changedFrame(frame: SampleFrame, change: FrameChange, columns: readonly ColumnInfo[]): SampleFrame {
  const made = change.map((row, c) => {
    const out = new Float64Array(frame.n);
    const period = columns[c]?.period ?? 0;
    for (let i = 0; i < frame.n; i++) out[i] = inFrame(row, (k) => Number(frame.columns[k]![i]), period);
    return out;
  });
  return { ...frame, columns: frame.columns.map((column, c) => made[c] ?? column) };
}

/** The frame of Euler angles that belongs to a frame of rotations. */
export function eulerFrame(frame: SampleFrame): SampleFrame {
  return {
    ...frame,
    channel: -1 - frame.channel,
    dropped: 0,
    columns: eulerColumns(frame.columns as readonly (Numbers & Column)[], frame.n),
  };
}
