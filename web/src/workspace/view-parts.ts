/** The parts of a workspace that every view has: window, cursors, time base, frame, series and plots shown, the folded side. */
import type { WorldFrame } from "../data/rotations";
import { LONGEST, SHORTEST } from "../data/view-actions";
import { seriesOf, takeSeries } from "../page/permalink";
import { DEFAULT_LAYOUT, layoutJson, layoutOf } from "../data/layout";
import { registerPart } from "./parts";
import { isKeys, isNumber, isObject, type Json, type JsonObject } from "../data/json";
import { plotsOfWords, plotWord } from "../signals/custom-plots";
import type { YAxis, PlotOrder } from "../data/view";
import { DEFAULT_ORDER, PLOT_HEIGHT } from "../data/plot-order";

/** Times within a workspace: from 1970 to the year 5138, unix s. */
const [FIRST, LAST] = [0, 1e11];
const FRAMES: readonly WorldFrame[] = ["ENU", "NED", "NWU"];

/** A window that follows the newest sample, or one that stands still. */
type Range = { readonly span: number } | { readonly t0: number; readonly t1: number };

registerPart<Range>({
  key: "range",
  isNamedInLinks: true,
  isMoment: true,
  read({ viewState }) {
    const { live, end, span } = viewState.view.peek();
    return live ? { span } : { t0: end - span, t1: end };
  },
  check(json) {
    if (!isObject(json)) return undefined;
    const { span, t0, t1 } = json;
    if (isNumber(span, SHORTEST, LONGEST)) return { span };
    return isNumber(t0, FIRST, LAST) && isNumber(t1, FIRST, LAST) && t1 > t0 ? { t0, t1 } : undefined;
  },
  write({ viewState: { view }, bounds }, range) {
    if (range === undefined) return;
    if ("span" in range) {
      // a recording has no newest sample to follow: its window stays
      if (!bounds) view.value = { ...view.peek(), live: true, span: range.span };
      return;
    }
    const { t0, t1 } = range;
    if (bounds && (t1 <= bounds.first || t0 >= bounds.last)) return;
    view.value = { ...view.peek(), live: false, end: t1, span: t1 - t0 };
  },
});

/** Times of both cursors, unix s; null: there is none. */
type Cursors = { readonly reading: number | null; readonly measuring: number | null };

const isTime = (json: Json | undefined): json is number | null => json === null || isNumber(json, FIRST, LAST);

registerPart<Cursors>({
  key: "cursors",
  isNamedInLinks: true,
  isMoment: true,
  read({ viewState: { cursor, measure } }) {
    const at = cursor.peek();
    return { reading: at?.kind === "pinned" ? at.time : null, measuring: measure.peek() ?? null };
  },
  check(json) {
    if (!isObject(json)) return undefined;
    const { reading, measuring } = json;
    return isTime(reading) && isTime(measuring) ? { reading, measuring } : undefined;
  },
  write({ viewState: { cursor, measure }, bounds }, cursors) {
    if (cursors === undefined) return;
    const { reading, measuring } = cursors;
    const fits = (time: number): boolean => !bounds || (time >= bounds.first && time <= bounds.last);
    // a recording is always read somewhere
    if (reading !== null && fits(reading)) cursor.value = { kind: "pinned", time: reading };
    else if (!bounds) cursor.value = undefined;
    measure.value = measuring !== null && fits(measuring) ? measuring : undefined;
  },
});

registerPart<"arrival">({
  key: "timeBase",
  isNamedInLinks: true,
  read: ({ viewState: { view } }) => (view.peek().timeBase === "arrival" ? "arrival" : undefined),
  check: (json) => (json === "arrival" ? json : undefined),
  write({ viewState: { view } }, base) {
    view.value = { ...view.peek(), timeBase: base ?? "device" };
  },
});

registerPart<WorldFrame>({
  key: "frame",
  isNamedInLinks: true,
  read: ({ viewState: { frame } }) => frame.peek(),
  check: (json) => FRAMES.find((name) => name === json),
  write: ({ viewState: { frame } }, name) => void (frame.value = name),
});

/** Hidden series, and norms that are shown (they are hidden by default). */
type SeriesChoice = { readonly hide: readonly string[]; readonly show: readonly string[] };

registerPart<SeriesChoice>({
  key: "series",
  isNamedInLinks: true,
  read({ viewState: { hiddenSeries, knownNorms } }) {
    const { hide, show } = seriesOf(hiddenSeries.peek(), knownNorms);
    return hide.length + show.length > 0 ? { hide: [...hide].sort(), show: [...show].sort() } : undefined;
  },
  check(json) {
    if (!isObject(json)) return undefined;
    const { hide, show } = json;
    return isKeys(hide) && isKeys(show) && !hide.some((key) => show.includes(key)) ? { hide, show } : undefined;
  },
  write({ viewState: { hiddenSeries, knownNorms } }, series) {
    hiddenSeries.value = takeSeries(series ?? { hide: [], show: [] }, knownNorms);
  },
});

registerPart<readonly string[]>({
  key: "extraPlots",
  isNamedInLinks: true,
  read: ({ viewState: { extraPlots } }) => (extraPlots.peek().size > 0 ? [...extraPlots.peek()].sort() : undefined),
  check: (json) => (isKeys(json) ? json : undefined),
  write: ({ viewState: { extraPlots } }, keys) => void (extraPlots.value = new Set(keys)),
});

registerPart<true>({
  key: "sideFolded",
  read: ({ folded }) => (folded.peek() ? true : undefined),
  check: (json) => (json === true ? json : undefined),
  write: ({ folded }, isFolded) => void (folded.value = isFolded === true),
});

registerPart<JsonObject>({
  key: "layout",
  read: ({ viewState: { layout } }) => layoutJson(layout.peek()),
  check: (json) => {
    const layout = layoutOf(json);
    return layout && (layoutJson(layout) ?? {});
  },
  write: ({ viewState }, json) => void (viewState.layout.value = (json && layoutOf(json)) ?? DEFAULT_LAYOUT),
});

/* The part of a workspace with the plots that the user put together, as the words of a link (signals/custom-plots.ts). */

registerPart<readonly string[]>({
  key: "customPlots",
  isNamedInLinks: true,
  read({ viewState: { customPlots } }) {
    const words = [...new Set(customPlots.peek().map(plotWord))];
    return words.length > 0 ? words : undefined;
  },
  check: (json) => (isKeys(json) && plotsOfWords(json).map(plotWord).join(" ") === json.join(" ") ? json : undefined),
  write: ({ viewState: { customPlots } }, words) => void (customPlots.value = plotsOfWords(words ?? [])),
});

/* The part of a workspace with the chosen y axes: by plot key a range, and whether it is logarithmic. */

const MAX_ABS = 1e15;

function axisOf(json: Json): YAxis | undefined {
  if (!isObject(json)) return undefined;
  const { range, isLog } = json;
  if (isLog !== undefined && isLog !== true) return undefined;
  if (range === undefined) return isLog === true ? { isLog } : undefined;
  if (!Array.isArray(range) || range.length !== 2) return undefined;
  const [low, high] = range as readonly (Json | undefined)[];
  if (!isNumber(low, -MAX_ABS, MAX_ABS) || !isNumber(high, -MAX_ABS, MAX_ABS) || low >= high) return undefined;
  return isLog === true ? { range: [low, high], isLog } : { range: [low, high] };
}

const axesOf = (json: JsonObject): ReadonlyMap<string, YAxis> | undefined => {
  const found = Object.entries(json).map(([key, axis]) => [key, axisOf(axis)] as const);
  const known = found.flatMap(([key, axis]) => (axis ? [[key, axis] as const] : []));
  return known.length === found.length ? new Map(known) : undefined;
};

registerPart<JsonObject>({
  key: "yAxes",
  read({ viewState: { yAxes } }) {
    const axes = [...yAxes.peek()].sort(([a], [b]) => (a < b ? -1 : 1));
    return axes.length > 0 ? (Object.fromEntries(axes) as JsonObject) : undefined;
  },
  check: (json) => (isObject(json) && axesOf(json) ? json : undefined),
  write: ({ viewState: { yAxes } }, json) => void (yAxes.value = (json && axesOf(json)) ?? new Map()),
});

/* The part of a workspace with the order of the plots and their heights. */

function isOrder(json: Json): json is JsonObject {
  if (!isObject(json) || Object.keys(json).length === 0) return false;
  const { order, heights, tiles, ...rest } = json;
  const isHeights = (of: Json): boolean =>
    isObject(of) &&
    isKeys(Object.keys(of)) &&
    Object.keys(of).length > 0 &&
    Object.values(of).every((px) => isNumber(px, ...PLOT_HEIGHT));
  return (
    Object.keys(rest).length === 0 &&
    (order === undefined || (isKeys(order) && order.length > 0)) &&
    (heights === undefined || isHeights(heights)) &&
    (tiles === undefined ||
      (isObject(tiles) && isKeys(Object.keys(tiles)) && Object.values(tiles).every((tile) => isKeys([tile]))))
  );
}

registerPart<JsonObject>({
  key: "plotOrder",
  read({ viewState: { plotOrder } }) {
    const { order, heights, tiles } = plotOrder.peek();
    if (order === undefined && heights === undefined && tiles === undefined) return undefined;
    const sorted = <T extends Json>(of: Readonly<Record<string, T>>): Record<string, T> =>
      Object.fromEntries(Object.entries(of).sort(([a], [b]) => (a < b ? -1 : 1)));
    return {
      ...(heights ? { heights: sorted(heights) } : {}),
      ...(order ? { order: [...order] } : {}),
      ...(tiles ? { tiles: sorted(tiles) } : {}),
    };
  },
  check: (json) => (isOrder(json) ? json : undefined),
  write: ({ viewState: { plotOrder } }, json) => void (plotOrder.value = (json as PlotOrder) ?? DEFAULT_ORDER),
});
