/** The parts of a frame as rows: where they are, their bytes, what they mean, and the value on the wire. Pure. */
import { spaced } from "../forms/frame-chips";
import type { ShownSample } from "../page/context";
import type { PacketInfo } from "../wire/routes";

export interface PacketRow {
  readonly offset: number;
  readonly bytes: string;
  readonly words: string;
  /** Value on the wire; "" for the envelope, and where it is what the words say. */
  readonly raw: string;
  readonly isField: boolean;
  /** The sample that was asked for is here. */
  readonly isSample: boolean;
}

/** A longer run of bytes is cut here; the copy has them all. */
const MAX_BYTES = 32;

/** @param sample whose part is marked */
export function packetRows(
  { hex, spans, fields }: Pick<PacketInfo, "hex" | "spans" | "fields">,
  sample?: ShownSample,
): readonly PacketRow[] {
  const parts = spans.length > 0 ? spans : [{ offset: 0, size: hex.length / 2, label: "", path: "" }];
  return parts.map(({ offset, size, label, path }) => ({
    offset,
    bytes: spaced(hex.slice(2 * offset, 2 * (offset + size)), MAX_BYTES),
    words: label,
    raw: path === "" ? "" : rawText(fieldValue(fields, path)),
    isField: path !== "",
    isSample: sample !== undefined && isPartOf(path, sample),
  }));
}

/** Whether the part at a path has a sample: its column, or all of its channel where the frame has that in one part or it was computed. */
function isPartOf(path: string, { message, channel, column, at }: ShownSample): boolean {
  const name =
    channel === message ? column : channel.startsWith(`${message}.`) ? channel.slice(message.length + 1) : channel;
  if (path === name || path === `${name}.${at}`) return true;
  return at < 0 && path.startsWith(`${name}.`);
}

/** The value at a path: "acc.0", "outputs.3.rate". Names of fields may contain dots, so the longest that fits is taken. */
export function fieldValue(fields: unknown, path: string): unknown {
  if (path === "" || typeof fields !== "object" || fields === null) return path === "" ? fields : undefined;
  const words = path.split(".");
  for (let n = words.length; n > 0; n--) {
    const name = words.slice(0, n).join(".");
    if (Object.hasOwn(fields, name)) {
      const found = fieldValue((fields as Record<string, unknown>)[name], words.slice(n).join("."));
      if (found !== undefined) return found;
    }
  }
  return undefined;
}

/** Digits that tell two 32-bit numbers apart. */
const DIGITS = 9;

function rawText(value: unknown): string {
  if (typeof value === "number") return Number.isInteger(value) ? `${value}` : `${Number(value.toPrecision(DIGITS))}`;
  if (typeof value === "string" || typeof value === "boolean") return `${value}`;
  if (Array.isArray(value)) return value.map(rawText).join(", ");
  return "";
}
