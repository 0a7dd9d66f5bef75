/** The parts of a workspace that every view has: window, cursors, time base, frame, series and plots shown, the folded side. */
import type { WorldFrame } from "../data/rotations";
import { LONGEST, SHORTEST } from "../data/view-actions";
import { seriesOf, takeSeries } from "../page/permalink";
import { DEFAULT_LAYOUT, layoutJson, layoutOf } from "../data/layout";
import { registerPart } from "./parts";
import { isKeys, isNumber, isObject, type Json, type JsonObject } from "../data/json";

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
