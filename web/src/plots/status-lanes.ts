/**
 * Lanes of the status words over time. One lane per flag or bit group that has ever been of interest (set once, or an enumeration),
 * under a lane for losses; of a family with dozens, the ten most relevant, and the others one click away. Normal is neutral; yellow
 * and crimson are reserved for a warning and an error.
 *
 * Lanes are drawn from the OR and AND of the word in every pixel (minmax-pyramid.ts), so that a flag that was set for 5 ms is a mark at
 * any zoom, and the cost depends on the pixels only.
 */
import { OrAnd } from "../data/minmax-pyramid";
import type { Loss } from "../data/losses";
import { lowerBound } from "../data/line-breaks";
import type { Ring } from "../data/ring-buffer";
import type { Channel } from "../data/channels";
import type { TimeBase } from "../data/view";
import { age, number } from "../ui/format/format";
import { choiceWords, labelWords } from "../ui/format/labels";
import type { BitsInfo } from "../wire/types";
import { PixelColumns } from "./pixel-columns";
import { hatch, type Palette, setFont, type CanvasLayer } from "./canvas-style";
import { xOf, type TimeWindow } from "./time-window";
import { TEXT } from "../texts/plots";

export const LANE_PX = 17;
/** A loss or a fault is never narrower than this in its lane, px. */
const MIN_PX = 4;
const PULSE_PX = 3;
/** Room for a lane's name where it stands on the lane, px. */
const NAME_PX = 124;
/** In `states`: no sample yet, or the value changed within the pixel. */
const NOTHING = -1;
const MIXED = -2;

export interface Lane {
  readonly key: string;
  readonly name: string;
  readonly channel: Channel;
  readonly column: number;
  readonly bits: BitsInfo;
  /** Ascending order: 0 a fault that occurred … 5 a plain flag that never changed. */
  readonly rank: number;
}

const maskOf = ({ low, width }: BitsInfo): number => (width >= 32 ? -1 : (1 << width) - 1) << low;

/** Preferred lanes of a family with dozens of flags: the solution, the fix, and their source. */
const WANTED = /solution|fix|rtk|mode|filter|verified|interference/i;
/** Number of lanes shown initially, if more are of interest. */
const MAX_LANES = 8;
/** As many while the page is lower than this, px, so that the plots have room; a player needs some of it for its transport. */
const [LOW_PX, FEW_LANES, FEW_OF_PLAYER] = [1040, 4, 2];

/** Rank of a bit group; undefined: of no interest so far. */
function rankOf({ everSet, alwaysSet }: OrAnd, bits: BitsInfo): number | undefined {
  const mask = maskOf(bits);
  const wasSet = (everSet & mask) !== 0;
  const changed = ((everSet ^ alwaysSet) & mask) !== 0;
  const named = bits.width > 1 && Object.keys(bits.choices).length > 0;
  if (bits.severity !== "" && (bits.normal_set ? (alwaysSet & mask) === 0 : wasSet))
    return bits.severity === "error" ? 0 : 1;
  if (bits.severity !== "" && bits.normal_set) return bits.severity === "error" ? 0 : 1;
  if (named && bits.severity === "" && (changed || WANTED.test(bits.name))) return WANTED.test(bits.name) ? 2 : 3;
  if (named && bits.severity === "") return 5;
  if (!wasSet) return undefined;
  return changed ? 4 : 5;
}

/** The lanes of interest of a device's channels, faults first; equal ones of two messages are shown once. A product has no lane for a flag
that is `absent` in it. */
export function lanesOf(channels: readonly Channel[], absent: readonly string[] = []): Lane[] {
  const status = channels.filter(({ info }) => info.kind === "status");
  const found = new Map<string, Lane>();
  for (const channel of status) {
    const { info, ring } = channel;
    info.columns.forEach(({ bits: groups }, column) => {
      const pyramid = ring.pyramids[column];
      if (!(pyramid instanceof OrAnd) || ring.length === 0) return;
      for (const bits of groups) {
        const rank = bits.low > 31 || absent.includes(bits.name) ? undefined : rankOf(pyramid, bits);
        // The same word of a device comes in several messages; a "Status" is that of each part (GPS1, GPS2, IMU).
        const said = info.title === "Status" ? `${info.title} ${info.group.split(" ")[0]}` : info.title;
        const same = `${said}.${bits.name}`;
        if (rank === undefined || found.has(same)) continue;
        found.set(same, {
          key: `${info.id}.${column}.${bits.name}`,
          name: labelWords(bits.name),
          channel,
          column,
          bits,
          rank,
        });
      }
    });
  }
  return named([...found.values()].sort((a, b) => a.rank - b.rank));
}

/** Add the message to the names of two lanes that share one. */
function named(lanes: readonly Lane[]): Lane[] {
  return lanes.map((lane) => {
    const alone = lanes.filter(({ name }) => name === lane.name).length === 1;
    const { group, title } = lane.channel.info;
    const name = alone ? lane.name : `${lane.name} · ${group || title.split(" ")[0]}`;
    return { ...lane, name: shortened(name, lanes) };
  });
}

/** Characters of a name that the gutter shows. */
const NAME_SHOWN = 20;

/** Shorten names that differ only in the part cut by the gutter: drop their first word. */
function shortened(name: string, lanes: readonly Lane[]): string {
  const start = name.slice(0, NAME_SHOWN);
  const space = name.indexOf(" ");
  if (name.length <= NAME_SHOWN || space < 5 || lanes.filter((other) => other.name.startsWith(start)).length < 2)
    return name;
  return `${name.slice(0, 3)}.${name.slice(space)}`;
}

/** The lanes shown initially: all if they are few, else those that are wrong, set or changing. */
export function firstLanes(lanes: readonly Lane[], isLive: boolean): readonly Lane[] {
  const most = innerHeight >= LOW_PX ? MAX_LANES : isLive ? FEW_LANES : FEW_OF_PLAYER;
  // one that would stand alone behind a button stands in its place
  if (lanes.length <= most + 1) return lanes;
  const wrong = lanes.filter(({ rank }) => rank <= 1).length;
  return lanes.slice(0, Math.max(most, wrong)).filter(({ rank }) => rank < 5);
}

/** Keep the place of present lanes; new ones are added below, so that a flag raised for the first time moves no other. */
export function inPlace(before: readonly Lane[], next: readonly Lane[]): readonly Lane[] {
  const stays = before.flatMap(({ key }) => next.find((lane) => lane.key === key) ?? []);
  return [...stays, ...next.filter((lane) => !stays.includes(lane))];
}

/** Whether that state is to be highlighted. */
function raised(bits: BitsInfo, state: number): boolean {
  return bits.severity !== "" && state !== NOTHING && (bits.normal_set ? state === 0 : state !== 0);
}

/** A state in words: its choice, or the meaning of the flag. */
export function bitStateWords(bits: BitsInfo, state: number): string {
  if (state === NOTHING) return "";
  if (state === MIXED) return "changing";
  const choice = bits.choices[String(state)];
  if (choice !== undefined) return choiceWords(choice);
  return bits.width > 1 ? String(state) : state === 0 ? TEXT.notSet : "set";
}

/** The state of a lane at `t` (Infinity: the newest sample). */
export function stateAt({ channel: { ring }, column, bits }: Lane, t: number, base: TimeBase): number {
  const i = t === Infinity ? ring.length - 1 : ring.indexAt(t, base);
  return i < 0 ? NOTHING : ((ring.value(column, i) | 0) & maskOf(bits)) >>> bits.low;
}

interface Run {
  readonly from: number;
  to: number;
  readonly state: number;
}

/** Runs of one state among the pixels of a window: `or` and `and` are those of the word per pixel. */
export function runsOf(columns: PixelColumns, at: number, bits: BitsInfo, w: TimeWindow): Run[] {
  const { rows, mask, ring } = columns;
  const [or, and] = [columns.lo[at]!, columns.hi[at]!];
  const bit = maskOf(bits);
  const runs: Run[] = [];
  let state = before(ring, columns.columns[at]!, rows[w.g0 & mask]!, bits);
  let b = lowerBound(ring.breaks, rows[w.g0 & mask]!);
  const end = rows[w.g1 & mask]!;
  for (let g = w.g0; g < w.g1; g++) {
    const [from, to] = [rows[g & mask]!, rows[(g + 1) & mask]!];
    if (to > from) {
      const [set, always] = [(or[g & mask]! & bit) >>> bits.low, (and[g & mask]! & bit) >>> bits.low];
      // the worst state of the pixel is shown: a flag set at any time counts as set, one that should be set and was cleared as cleared
      state = set === always ? set : bits.width > 1 ? MIXED : bits.normal_set ? 0 : 1;
    } else if (from >= end && from >= ring.end)
      state = NOTHING; // unknown after the newest sample
    else if (ring.breaks[b] === from && from > ring.first) state = NOTHING; // inside a gap
    while (b < ring.breaks.length && ring.breaks[b]! < to) b++;
    const last = runs.at(-1);
    if (last !== undefined && last.state === state && last.to === g) last.to = g + 1;
    else if (state !== NOTHING) runs.push({ from: g, to: g + 1, state });
  }
  return runs;
}

/** State of the last sample before `row`: it holds until the next one. */
function before(ring: Ring, column: number, row: number, bits: BitsInfo): number {
  if (row <= ring.first || row >= ring.end) return NOTHING;
  return ((ring.columns[column]![(row - 1) & ring.mask]! | 0) & maskOf(bits)) >>> bits.low;
}

/** A run as drawn, px. */
interface Bar {
  readonly a: number;
  readonly b: number;
  readonly state: number;
  /** In a highlighted state. */
  readonly hot: boolean;
}

function drawBar(
  x: CanvasRenderingContext2D,
  { a, b, state, hot }: Bar,
  bits: BitsInfo,
  y: number,
  look: Palette,
): void {
  const height = LANE_PX - 4;
  // a pulse of a plain flag is a tick, not a bar: it has no room for text
  const pulse = bits.width === 1 && b - a < PULSE_PX;
  const quiet = state === MIXED ? "bg-active" : pulse ? "ink-3" : "bg-hover";
  x.fillStyle = look.colour[hot ? (bits.severity === "error" ? "status-bad" : "status-warn") : quiet];
  x.fillRect(a, y + 1.5, b - a, height);
  if (state !== MIXED) return;
  x.fillStyle = hatch(x, look.colour.edge, 5);
  x.globalAlpha = 0.6;
  x.fillRect(a, y + 1.5, b - a, height);
  x.globalAlpha = 1;
}

/** All lanes of a device: pixel columns per status word, drawn row under row. */
export class Lanes {
  readonly #columns = new Map<Ring, PixelColumns>();

  draw(sheet: CanvasLayer, lanes: readonly Lane[], losses: readonly Loss[], w: TimeWindow, look: Palette): void {
    const x = sheet.begin();
    setFont(x, look, 11);
    x.textBaseline = "middle";
    x.textAlign = "left";
    x.fillStyle = look.colour.line;
    if (!look.narrow) {
      x.fillRect(sheet.snap(w.left) - 1, 0, 1, sheet.height);
      x.fillRect(sheet.snap(w.left + w.width), 0, 1, sheet.height);
    }
    x.save();
    x.beginPath();
    x.rect(w.left, 0, w.width, sheet.height);
    x.clip();
    this.#losses(x, losses, w, look);
    lanes.forEach((lane, k) => this.#lane(x, lane, (k + 1) * LANE_PX, w, look));
    x.restore();
  }

  #losses(x: CanvasRenderingContext2D, losses: readonly Loss[], w: TimeWindow, look: Palette): void {
    x.fillStyle = look.colour.grid;
    x.fillRect(w.left, LANE_PX - 1, w.width, 1);
    const seen = losses.filter(({ t0, t1 }) => t1 >= w.t0 && t0 <= w.t1);
    seen.forEach((loss, k) => {
      const from = xOf(w, loss.t0);
      const to = Math.max(from + MIN_PX, xOf(w, loss.t1));
      x.fillStyle = look.colour.loss;
      x.fillRect(from, 1.5, to - from, LANE_PX - 4);
      const text = laneLossWords(loss);
      const next = seen[k + 1];
      if (next !== undefined && xOf(w, next.t0) < to + x.measureText(text).width + 14) return;
      x.fillStyle = look.colour["ink-2"];
      x.fillText(text, to + 7, LANE_PX / 2 + 0.5);
    });
  }

  #lane(x: CanvasRenderingContext2D, lane: Lane, y: number, w: TimeWindow, look: Palette): void {
    const { bits, channel, column } = lane;
    const columns = this.#of(channel, w);
    const at = columns.columns.indexOf(column);
    x.fillStyle = look.colour.grid;
    x.fillRect(w.left, y + LANE_PX - 1, w.width, 1);
    const px = (g: number): number => w.left + (g - w.g0) / w.ratio;
    const bars = runsOf(columns, at, bits, w).map(({ from, to, state }): Bar => {
      const hot = raised(bits, state);
      return { a: px(from), b: Math.max(px(to) - 1, px(from) + (hot ? MIN_PX : 1)), state, hot };
    });
    for (const bar of bars) if (bar.state !== 0 || bar.hot || bits.width > 1) drawBar(x, bar, bits, y, look);
    // names are on the data if the gutter is narrow: words start after them
    let free = look.narrow ? w.left + NAME_PX : w.left;
    bars.forEach(({ a, b, state, hot }, k) => {
      const text = state === MIXED || (state === 0 && !hot && bits.width === 1) ? "" : bitStateWords(bits, state);
      const width = x.measureText(text).width;
      // the text of a fault is on its own colour if there is room, else after it; never on the next one's colour
      const inside = b - Math.max(a + 7, free) >= width + 5;
      const from = Math.max(inside || !hot ? a + 7 : b + 7, free);
      const next = bars[k + 1];
      const room = inside || (hot && !(next?.hot && next.a < from + width + 4));
      if (text === "" || !room) return;
      x.fillStyle =
        look.colour[!inside || !hot ? "ink-2" : bits.severity === "error" ? "status-bad-ink" : "status-warn-ink"];
      x.fillText(text, from, y + LANE_PX / 2 + 0.5);
      free = from + width + 8;
    });
  }

  #of(channel: Channel, w: TimeWindow): PixelColumns {
    let columns = this.#columns.get(channel.ring);
    if (columns === undefined) {
      const words = channel.info.columns.flatMap(({ bits }, c) => (bits.length > 0 ? [c] : []));
      this.#columns.set(channel.ring, (columns = new PixelColumns(channel.ring, words)));
    }
    columns.prepare(w.g0, w.g1, w.dt, w.base);
    return columns;
  }

  /** Drop channels that no longer exist. */
  keep(channels: readonly Channel[]): void {
    for (const ring of this.#columns.keys())
      if (!channels.some((channel) => channel.ring === ring)) this.#columns.delete(ring);
  }
}

/** "72 samples, 180 ms". */
export function laneLossWords({ samples, t0, t1, by }: Loss): string {
  const count = samples > 0 ? TEXT.samplesThen(samples) : "";
  const { value, unit } = t1 - t0 < 10 && t1 - t0 >= 1 ? { value: number(t1 - t0, 2), unit: "s" } : age(t1 - t0);
  return `${count}${value} ${unit}${{ device: "", browser: TEXT.thisBrowser, server: TEXT.serverRestarted }[by]}`;
}
