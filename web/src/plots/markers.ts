/** Markers and notes on the plots: a violet line through all of them, with a flag and its words at the top. */
import type { EventInfo } from "../wire/types";
import { fitting, type Palette, setFont } from "./canvas-style";
import { xOf, type TimeWindow } from "./time-window";
import type { Store } from "../data/store";
import type { ViewState } from "../data/view-state";
import { COMMON } from "../texts/common";

/** A marker for drawing. */
export interface MarkLine {
  readonly time: number;
  /** "" for one without words. */
  readonly text: string;
}

/** Words are cut to this, px; with less room than MIN_PX before the next marker they are omitted. */
const MAX_PX = 160;
const MIN_PX = 26;
const FLAG_PX = 8;

/** The words of a marker without text. */
const NO_WORDS = COMMON.marker;

/** The markers among events, of a device or of all. */
export function markersIn(events: readonly EventInfo[], device: string | undefined): readonly MarkLine[] {
  return events
    .filter((event) => event.kind === "marker" && (event.device === "" || event.device === device))
    .map(({ time, text }) => ({ time, text: text === NO_WORDS ? "" : text }));
}

/** Times of events, or of the markers among them, of a device or of all. */
export function placesOf(
  events: readonly EventInfo[],
  kind: "event" | "marker",
  device: string | undefined,
): readonly number[] {
  const own = events.filter((event) => event.device === "" || event.device === device);
  return own.filter((event) => kind === "event" || event.kind === "marker").map(({ time }) => time);
}

/** The markers in a window, in order, each with its position and the room for its words, px. */
export function placed(
  markers: readonly MarkLine[],
  w: TimeWindow,
): readonly (MarkLine & { readonly x: number; readonly room: number })[] {
  const seen = markers.filter(({ time }) => time >= w.t0 && time <= w.t1).sort((a, b) => a.time - b.time);
  return seen.map((marker, k) => {
    const x = xOf(w, marker.time);
    const next = seen[k + 1];
    const end = next === undefined ? w.left + w.width : xOf(w, next.time);
    return { ...marker, x, room: Math.min(MAX_PX, end - x - FLAG_PX - 8) };
  });
}

/** Draw them from `top` to `bottom`, px; the flags stand at `top`. */
export function drawMarkers(
  x: CanvasRenderingContext2D,
  markers: readonly MarkLine[],
  w: TimeWindow,
  look: Palette,
  top: number,
  bottom: number,
): void {
  setFont(x, look, 11);
  [x.textAlign, x.textBaseline] = ["left", "middle"];
  for (const { x: px, room, text } of placed(markers, w)) {
    x.fillStyle = look.colour.yours;
    x.fillRect(Math.round(px) - 0.5, top, 1, bottom - top);
    x.beginPath();
    x.moveTo(px, top + 1);
    x.lineTo(px + FLAG_PX, top + 5);
    x.lineTo(px, top + 9);
    x.fill();
    if (text === "" || room < MIN_PX) continue;
    x.fillText(fitting(x, text, room), px + FLAG_PX + 3, top + 6);
  }
}

/** The markers among the events of a store, updated when there are new events. */
export function markersOf(store: Store, { view }: ViewState): () => readonly MarkLine[] {
  let [from, device, found]: [unknown, string | undefined, readonly MarkLine[]] = [undefined, undefined, []];
  return () => {
    const now = view.peek().device;
    if (from !== store.events.peek() || device !== now)
      [from, device, found] = [store.events.peek(), now, markersIn(store.events.peek(), now)];
    return found;
  };
}
