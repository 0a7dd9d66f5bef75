/**
 * The legend of a plot: its name and unit, and for every series its letter and the value at the cursor. A series is a button: a
 * click hides or shows it, with Shift it is shown alone.
 */
import type { Reads, TimeBase, PlotSpec, Series } from "../data/view";
import { lowerBound } from "../data/line-breaks";
import { wrapped } from "../data/statistics";
import type { ShownSample } from "../page/context";
import type { ChannelInfo } from "../wire/types";
import { number } from "../ui/format/format";
import { el, LiveText, unit } from "../ui/dom/dom";
import { TEXT } from "../texts/plots";

/** A cursor this long after the newest sample still reads it, s: samples are in transit. */
const ON_THEIR_WAY_S = 0.25;

/** The row of a series' ring read by a cursor at `t`; −1 if there is none, or a gap. */
function rowAt({ channel: { ring } }: Pick<Series, "channel">, t: number, base: TimeBase): number {
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

const asDrawn: Reads = (channel) => channel;

/** The value there; NaN if there is none. */
export function valueAt(series: Series, t: number, base: TimeBase, reads: Reads = asDrawn): number {
  const channel = reads(series.channel, t);
  const row = rowAt({ channel }, t, base);
  const { ring } = channel;
  return row < 0 ? NaN : ring.columns[series.column]![row & ring.mask]!;
}

/** Whether a line is whole, dashed or dotted: the class of its sample. */
const lineKind = ({ dash: [stroke = Infinity] }: Series): string =>
  stroke === Infinity ? "whole" : stroke < DOT_PX ? "dotted" : "dashes";
/** Shorter strokes are dots, px. */
const DOT_PX = 3;

/** Rows of the legend beside a plot. Of a device's own plot the norm is not counted: that one goes where there is no room. */
export const legendRows = ({ series }: PlotSpec): number =>
  series.filter(({ norm }) => !norm || series.some(({ mark }) => mark !== undefined)).length +
  series.filter(({ heading }, k) => heading !== undefined && heading !== series[k - 1]?.heading).length;

/** Whether the title of a plot is the name of its only series, which then needs none. */
export const namedByTitle = ({ series, title }: PlotSpec): boolean => series.length === 1 && series[0]!.label === title;

/** @param sent the channel as its device sends it */
export function shownSample(series: Series, value: number, sent: ChannelInfo | undefined): ShownSample {
  const { channel, column, decimals } = series;
  const { info } = channel;
  const own = info.columns[column];
  const at = info.id < 0 || series.norm ? -1 : column;
  const unitText = own?.unit || info.unit;
  return {
    name: info.columns.length === 1 ? info.title || info.name : `${info.title || info.name} ${own?.label || own?.name}`,
    value: `${number(value, decimals)} ${unitText}`.trim(),
    message: sent?.message ?? info.message,
    channel: sent?.name ?? info.name,
    column: own?.name ?? "",
    at,
  };
}

/** Frames that are named: a velocity or a position is meaningless without one; and body frames chosen by the user. */
const NAMED = new Set(["ENU", "NED", "NWU", "ECEF", "FLU", "FRD"]);

interface Row {
  readonly series: Series;
  readonly button: HTMLButtonElement;
  readonly value: LiveText;
  readonly text: HTMLElement;
  /** Characters reserved for the value. */
  width: number;
}

/** Hides or shows the series of that key; `alone`: shows it alone in its plot. */
export type Toggle = (key: string, alone: boolean) => void;

export interface SeriesMenu {
  /** The title of the series, with a word of that. */
  readonly title: (title: string) => string;
  readonly open: () => void;
}

export interface LegendActions {
  /** Takes a plot that the user put together away. */
  readonly remove?: (() => void) | undefined;
  readonly menu?: ((series: Series) => SeriesMenu | undefined) | undefined;
}

export class Legend {
  readonly root: HTMLElement;
  readonly #rows: readonly Row[];

  readonly #toggle: Toggle;
  readonly #menu: LegendActions["menu"];

  constructor(spec: PlotSpec, toggle: Toggle, { remove, menu }: LegendActions = {}) {
    this.#toggle = toggle;
    this.#menu = menu;
    const head = el("b", { class: "ellipsis" }, spec.title);
    // quantities along the sensor's own axes need no frame name; motion does
    const named = spec.unit === "°" || spec.unit === "m/s" || NAMED.has(spec.frame);
    const frame = spec.frame === "" || !named ? "" : ` ${spec.frame}`;
    if (spec.unit + frame !== "") head.append(unit(spec.unit + frame));
    const about = spec.series[0]?.channel.info;
    if (about?.verified === false)
      head.append(
        " ",
        el("span", { class: "tag warn", title: TEXT.unverifiedHint }, "▲"),
        el("span", { class: "visually-hidden" }, TEXT.unverified),
      );
    head.title = [about?.group, about?.doc, spec.frame && TEXT.frameOf(about?.frame ?? spec.frame)]
      .filter(Boolean)
      .join(" ");
    const isNamed = namedByTitle(spec);
    this.#rows = spec.series.map((series) => this.#row(series, isNamed));
    const dashed = spec.series.some(({ dash }) => dash.length > 0);
    this.root = el("div", { class: dashed ? "legend dashed" : "legend" }, head);
    let above: string | undefined;
    for (const { series, button } of this.#rows) {
      if (series.heading !== undefined && series.heading !== above)
        this.root.append(el("span", { class: "series-heading ellipsis", title: series.heading }, series.heading));
      above = series.heading;
      this.root.append(button);
    }
    if (remove === undefined) return;
    const label = TEXT.removePlot(spec.title);
    const button = el("button", { type: "button", class: "remove-plot", "aria-label": label, title: label }, "×");
    button.addEventListener("click", remove);
    this.root.append(button);
  }

  #row(series: Series, isNamed: boolean): Row {
    const letter = el("i", { class: `${series.colour} ellipsis`, title: series.label }, isNamed ? "" : series.label);
    letter.prepend(el("span", { class: `line-sample ${lineKind(series)}`, "aria-hidden": "true" }));
    const value = new LiveText();
    const text = el("span", { class: "series-value" });
    text.append(value.node);
    const info = series.channel.info.columns[series.column];
    const rightUnit = series.isRight ? info?.unit || series.channel.info.unit : "";
    const name = series.channel.info.title || series.channel.info.name;
    const button = el(
      "button",
      { type: "button", class: series.norm ? "series norm" : "series", "aria-pressed": "true" },
      el("span", { class: "visually-hidden" }, `${name} `),
      letter,
      " ",
      text,
      ...(rightUnit === "" ? [] : [unit(rightUnit)]),
    );
    button.title = TEXT.toggleSeries(series.isRight ? TEXT.onRightAxis(name, "") : name, series.label);
    button.addEventListener("click", (event) => this.#toggle(series.key, event.shiftKey));
    const menu = this.#menu?.(series);
    if (menu) {
      button.title = menu.title(button.title);
      button.setAttribute("aria-haspopup", "dialog");
      // The menu key and a long touch raise this event, too.
      button.addEventListener("contextmenu", (event) => {
        event.preventDefault();
        event.stopPropagation();
        menu.open();
      });
    }
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
      const decimals = narrow && this.#rows.length > 1 ? Math.min(2, series.decimals) : series.decimals;
      const text =
        to === undefined
          ? number(now, decimals)
          : TEXT.change(number(differenceOf(series, t, to, base, reads), decimals));
      value.set(text);
      if (narrow) makeRoom(row, Math.max(text.length, decimals + usualRoom(series)));
      button.classList.toggle("difference", to !== undefined);
      button.classList.toggle("old", t === Infinity && isOld(series, edge));
    }
  }
}

/** Newest values older than this, s, and than this many of their intervals, are not current. */
const OLD_S = 3;
const OLD_STEPS = 5;

function isOld({ channel: { ring } }: Series, edge: number): boolean {
  return ring.length > 0 && edge - ring.arrival(ring.length - 1) > Math.max(OLD_S, OLD_STEPS * (ring.step || 0));
}

/** Above a plot the values are in a row: width once taken is kept, so that nothing moves when digits come and go. */
function makeRoom(row: Row, characters: number): void {
  if (characters <= row.width) return;
  row.width = characters;
  row.text.style.width = `${characters}ch`; // not min-width: a minus may come from a slightly wider font
}

/** Characters of a value before its decimals: an angle "−179.", an acceleration "−19.", most others "−9.". */
const ROOM: Readonly<Record<string, number>> = { "°": 5, "°/s": 5, "m/s²": 4, µT: 4 };
const MIN_ROOM = 3;

function usualRoom({ channel, column }: Series): number {
  return ROOM[channel.info.columns[column]?.unit || channel.info.unit] ?? MIN_ROOM;
}

/** Change of a series from `t` to `to`: the second less the first, for an angle the short way round. */
export function differenceOf(series: Series, t: number, to: number, base: TimeBase, reads: Reads = asDrawn): number {
  const d = valueAt(series, to, base, reads) - valueAt(series, t, base, reads);
  const period = series.channel.info.columns[series.column]?.period ?? 0;
  return period > 0 ? wrapped(d, period) : d;
}
