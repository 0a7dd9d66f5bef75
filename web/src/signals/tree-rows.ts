/** The rows of the tree of signals: devices, their channels, and the columns of these, as far as they are unfolded or found. */
import type { Channel } from "../data/channels";
import { fullName, shortName } from "../wire/device-name";
import type { DeviceInfo } from "../wire/types";
import { plottable } from "./custom-plots";
import { columnWords, searchWords, quantityWords } from "./quantities";

export interface TreeRow {
  /** Constant for the same device, channel or column. */
  readonly key: string;
  readonly level: 1 | 2 | 3;
  readonly name: string;
  readonly device: DeviceInfo;
  readonly channel?: Channel;
  /** Columns that the row stands for; empty for a device. */
  readonly columns: readonly number[];
  /** Undefined: it has nothing under it. */
  readonly open?: boolean;
}

/** Whether every word occurs in one of the texts, in lower case; a letter or an index only as a word of its own. */
function matches(words: readonly string[], texts: readonly string[]): boolean {
  const all = texts.join(" ").toLowerCase();
  const single = new Set(all.split(/[\s,]+/));
  return words.every((word) => (word.length === 1 || word.startsWith("[") ? single.has(word) : all.includes(word)));
}

/**
 * The rows on screen.
 *
 * @param open keys of unfolded rows; while something is searched, what is found is unfolded
 */
export function treeRows(
  devices: readonly DeviceInfo[],
  channels: readonly Channel[],
  open: ReadonlySet<string>,
  search: string,
): readonly TreeRow[] {
  const words = searchWords(search);
  return devices.flatMap((device) => {
    const own = channels.filter((channel) => channel.info.device === device.id && plottable(channel).length > 0);
    const below = own.flatMap((channel) => channelRows(device, channel, open, words));
    if (words.length > 0 && below.length === 0) return [];
    const key = device.id;
    const isOpen = words.length > 0 || open.has(key);
    const row: TreeRow = { key, level: 1, name: shortName(device), device, columns: [], open: isOpen };
    return isOpen ? [row, ...below] : [row];
  });
}

function channelRows(
  device: DeviceInfo,
  channel: Channel,
  open: ReadonlySet<string>,
  words: readonly string[],
): readonly TreeRow[] {
  const { info } = channel;
  const key = `${device.id}/${info.name}`;
  const columns = plottable(channel);
  const about = [fullName(device), info.title, info.name, info.group, info.unit, info.frame, quantityWords(info)];
  const found = columns.flatMap((c) => {
    const column = info.columns[c];
    return column &&
      matches(words, [...about, column.name, column.label, column.unit, columnWords(info, column.name, c)])
      ? [{ c, ...column }]
      : [];
  });
  if (found.length === 0) return [];
  const name = info.title || info.name;
  const row: TreeRow = { key, level: 2, name, device, channel, columns };
  if (columns.length === 1) return [row];
  const isOpen = open.has(key) || (words.length > 0 && found.length < columns.length);
  const below = found.map<TreeRow>(({ c, name: own, label }) => ({
    key: `${key}/${own}`,
    level: 3,
    name: label || own,
    device,
    channel,
    columns: [c],
  }));
  return [{ ...row, open: isOpen }, ...(isOpen ? below : [])];
}

/** Key of the row that a row is under. */
export function parentOf(rows: readonly TreeRow[], at: number): number {
  const { level } = rows[at] ?? { level: 1 };
  const above = rows.slice(0, at).findLastIndex((row) => row.level < level);
  return above < 0 ? at : above;
}

/**
 * A sparkline in a box: the extremes of each interval, joined where there are samples.
 *
 * @param of what the box holds; default: all of it
 */
export function sparkPath(
  { lo, hi }: { readonly lo: Float64Array; readonly hi: Float64Array },
  width: number,
  height: number,
  of?: { readonly least: number; readonly greatest: number },
): string {
  const least = of?.least ?? Math.min(...lo.filter(Number.isFinite));
  const greatest = of?.greatest ?? Math.max(...hi.filter(Number.isFinite));
  if (!(least <= greatest)) return "";
  const range = greatest - least;
  const y = (value: number): string => (range > 0 ? (1 - (value - least) / range) * height : height / 2).toFixed(1);
  let path = "";
  let isDrawn = false;
  lo.forEach((low, k) => {
    const high = hi[k] ?? NaN;
    const isKnown = low <= high;
    if (isKnown) {
      const x = (((k + 0.5) * width) / lo.length).toFixed(1);
      path += `${isDrawn ? "L" : "M"}${x} ${y(low)}L${x} ${y(high)}`;
    }
    isDrawn = isKnown;
  });
  return path;
}
