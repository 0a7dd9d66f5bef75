/**
 * What stands beside a plot: its name and unit, and for every series its letter and the value at the cursor. A series is a
 * button: a click hides or shows it, with Shift it stands alone.
 */
import { toggleKey } from "../data/view-actions";
import { lowerBound } from "../data/line-breaks";
import { wrapped } from "../data/statistics";
import type { Channel } from "../data/channels";
import type { TimeBase } from "../data/view-state";
import { number } from "../ui/format";
import { el, Live, unit } from "../ui/dom";
import type { PlotSpec, Series } from "./plot-selection";

/** A cursor this long after the newest sample still reads it, s: samples are on their way. */
const ON_THEIR_WAY_S = 0.25;

/** The row of a series' ring that a cursor at `t` reads; −1 when there is none, or a gap. */
export function rowAt({ channel: { ring } }: Pick<Series, "channel">, t: number, base: TimeBase): number {
  if (ring.length === 0) return -1;
  if (t === Infinity) return ring.end - 1;
  const i = ring.indexAt(t, base);
  if (i < 0) return -1;
  const age = t - (base === "device" ? ring.time(i) : ring.arrival(i));
  const fresh = 2.5 * (ring.step || 0);
  if (i === ring.length - 1) return age <= Math.max(ON_THEIR_WAY_S, fresh) ? ring.end - 1 : -1;
  const next = ring.first + i + 1;
  return age > fresh && ring.breaks[lowerBound(ring.breaks, next)] === next ? -1 : next - 1;
}

/** Where the samples of a channel are as they came around a time, when what is drawn of it is summarised. */
export type Reads = (channel: Channel, t: number) => Channel;
const asDrawn: Reads = (channel) => channel;

/** The value there; NaN when there is none. */
export function valueAt(series: Series, t: number, base: TimeBase, reads: Reads = asDrawn): number {
  const channel = reads(series.channel, t);
  const row = rowAt({ channel }, t, base);
  const { ring } = channel;
  return row < 0 ? NaN : ring.columns[series.column]![row & ring.mask]!;
}

/** Frames of the world: a velocity or a position means nothing without one; and those of the body that were chosen. */
const NAMED = new Set(["ENU", "NED", "NWU", "ECEF", "FLU", "FRD"]);

interface Row {
  readonly series: Series;
  readonly button: HTMLButtonElement;
  readonly value: Live;
  readonly text: HTMLElement;
  /** Characters that the value has room for. */
  width: number;
}

export class Legend {
  readonly root: HTMLElement;
  readonly #rows: readonly Row[];

  constructor(spec: PlotSpec) {
    const head = el("b", {}, spec.title);
    // What is felt along the sensor's own axes needs no word; how it moves does.
    const named = spec.unit === "°" || spec.unit === "m/s" || NAMED.has(spec.frame);
    const frame = spec.frame === "" || !named ? "" : ` ${spec.frame}`;
    if (spec.unit + frame !== "") head.append(unit(spec.unit + frame));
    const about = spec.series[0]?.channel.info;
    if (about?.verified === false) head.append(" ", el("span", { class: "tag warn", title: "Unverified: nobody could check who sent this" }, "▲"), el("span", { class: "vh" }, "unverified"));
    head.title = [about?.group, about?.doc, spec.frame && `Frame: ${about?.frame ?? spec.frame}.`].filter(Boolean).join(" ");
    this.#rows = spec.series.map((series) => this.#row(series));
    this.root = el("div", { class: "leg" }, head, ...this.#rows.map(({ button }) => button));
  }

  #row(series: Series): Row {
    const letter = el("i", { class: series.colour.slice(5) }, series.label);
    const value = new Live();
    const text = el("span", { class: "v" });
    text.append(value.node);
    const name = series.channel.info.title || series.channel.info.name;
    const button = el("button", { type: "button", class: series.norm ? "k norm" : "k", "aria-pressed": "true" }, el("span", { class: "vh" }, `${name} `), letter, " ", text);
    button.title = `${name} ${series.label}: click to hide or show, with Shift alone`;
    button.addEventListener("click", (event) => toggleKey(series.key, event.shiftKey));
    return { series, button, value, text, width: 0 };
  }

  /** Which series are drawn. */
  show(hidden: ReadonlySet<string>): void {
    for (const { series, button } of this.#rows) button.setAttribute("aria-pressed", String(!hidden.has(series.key)));
  }

  /** Values at `t` (Infinity: the newest); with `to`, the second cursor, how much they change from here to there. */
  read(t: number, base: TimeBase, to: number | undefined, narrow: boolean, reads: Reads = asDrawn, edge = NaN): void {
    for (const row of this.#rows) {
      const { series, button, value } = row;
      const now = valueAt(series, t, base, reads);
      const decimals = narrow ? Math.min(2, series.decimals) : series.decimals;
      const text = to === undefined ? number(now, decimals) : `Δ ${number(changeOf(series, t, to, base, reads), decimals)}`;
      value.set(text);
      if (narrow) makeRoom(row, Math.max(text.length, decimals + usualRoom(series)));
      button.classList.toggle("diff", to !== undefined);
      button.classList.toggle("old", t === Infinity && isOld(series, edge));
    }
  }
}

/** Newest values that came longer ago than this, s, and than so many of their spacings, are not those of now. */
const OLD_S = 3;
const OLD_STEPS = 5;

function isOld({ channel: { ring } }: Series, edge: number): boolean {
  return ring.length > 0 && edge - ring.arrival(ring.length - 1) > Math.max(OLD_S, OLD_STEPS * (ring.step || 0));
}

/** Above a plot the values stand in a row: room once taken is kept, so that nothing moves when digits come and go. */
function makeRoom(row: Row, characters: number): void {
  if (characters <= row.width) return;
  row.width = characters;
  row.text.style.width = `${characters}ch`; // not at least so wide: a minus may come from a font that is wider by a hair
}

/** Characters that a value needs before its decimals: an angle "−179.", an acceleration "−19.", most else "−9.". */
const ROOM: Readonly<Record<string, number>> = { "°": 5, "°/s": 5, "m/s²": 4, "µT": 4 };
const LEAST_ROOM = 3;

function usualRoom({ channel, column }: Series): number {
  return ROOM[channel.info.columns[column]?.unit || channel.info.unit] ?? LEAST_ROOM;
}

/** How much a series changes from `t` to `to`: the second less the first, of an angle the short way round. */
export function changeOf(series: Series, t: number, to: number, base: TimeBase, reads: Reads = asDrawn): number {
  const d = valueAt(series, to, base, reads) - valueAt(series, t, base, reads);
  const period = series.channel.info.columns[series.column]?.period ?? 0;
  return period > 0 ? wrapped(d, period) : d;
}
