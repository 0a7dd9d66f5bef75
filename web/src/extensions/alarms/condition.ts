/** The condition of a new alarm on a signal, with a limit from the cursor or from what the window holds. Pure. */
import type { CursorReading } from "../../data/cursor-time";
import { sampleAt } from "../../panels/panel-context";
import { quoted } from "../../signals/names";
import type { TreeRow } from "../../signals/tree-rows";

/** Samples that are looked at for a limit. */
const MAX_LIMIT_SAMPLES = 200_000;
/** Share of the range by which a limit is beyond all values of the window. */
const MARGIN_SHARE = 0.25;

type Signals = Pick<TreeRow, "channel" | "columns">;

/** Whether the server knows a signal, so that an alarm can watch it. */
export function canAlarm({ channel, columns }: Signals): boolean {
  return channel !== undefined && channel.info.id >= 0 && columns.length > 0;
}

/**
 * A condition such as `norm(Acceleration) > 12 m/s²`. With a cursor its limit is the value there, on the side that is less usual in
 * the window; else it is a little above all values of the window.
 */
export function alarmCondition(row: Signals, at: CursorReading): string {
  const { channel, columns } = row;
  if (!channel) return "";
  const { info, ring } = channel;
  const named = columns.filter((c) => info.columns[c]?.name !== "norm");
  const [first = 0] = named.length > 0 ? named : columns;
  const isWhole = columns.length > 1 || named.length === 0;
  const unit = info.columns[first]?.unit || info.unit;
  const measured = isWhole ? ownColumns(row) : [first];
  const valueAt = (i: number): number =>
    isWhole ? Math.hypot(...measured.map((c) => ring.value(c, i))) : ring.value(first, i);
  const name = quoted(isWhole || info.columns.length === 1 ? info.name : `${info.name}.${info.columns[first]?.name}`);
  const last = Number.isFinite(at.to) ? ring.indexAt(at.to, at.base) : ring.length - 1;
  const from = Math.max(0, ring.indexAt(at.from, at.base), last - MAX_LIMIT_SAMPLES);
  const values: number[] = [];
  for (let i = from; i <= last; i++) {
    const value = valueAt(i);
    if (Number.isFinite(value)) values.push(value);
  }
  const i = at.word === "cursor" ? sampleAt(channel, at) : -1;
  const { sign, limit } = limitOf(values, i < 0 ? NaN : valueAt(i));
  const number = /^\d/.test(unit) || unit === "" ? `${limit}` : `${limit} ${unit}`;
  return `${isWhole ? `norm(${name})` : name} ${sign} ${number}`;
}

function ownColumns({ channel }: Signals): readonly number[] {
  const columns = channel?.info.columns ?? [];
  return columns.flatMap(({ name }, c) => (name === "norm" ? [] : [c]));
}

/** A limit for these values, of which one may be pointed at (NaN: none). */
export function limitOf(
  values: readonly number[],
  pointed: number,
): { readonly sign: ">" | "<"; readonly limit: number } {
  if (values.length === 0 && !Number.isFinite(pointed)) return { sign: ">", limit: 0 };
  let [least, greatest] = [Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
  for (const value of values) [least, greatest] = [Math.min(least, value), Math.max(greatest, value)];
  if (!Number.isFinite(pointed)) return { sign: ">", limit: rounded(greatest + MARGIN_SHARE * (greatest - least), 2) };
  const below = values.filter((value) => value < pointed).length;
  return { sign: 2 * below >= values.length ? ">" : "<", limit: rounded(pointed, 3) };
}

function rounded(value: number, digits: number): number {
  return Number(value.toPrecision(digits));
}
