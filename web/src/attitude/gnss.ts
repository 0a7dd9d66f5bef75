/**
 * Where is it? Fix, satellites, position and accuracy, and the track of the window; only where the device sends a position.
 * The position is found by its columns (latitude, longitude), so that any family's message will do.
 */
import type { Channel } from "../data/store";
import { view } from "../data/view";
import { type Deps, reading, sampleAt } from "../panels/deps";
import type { Reading } from "../panels/reading";
import { surface } from "../ui/canvas";
import { el, every, Live, type Panel, unit } from "../ui/dom";
import { geographic, NONE, number } from "../ui/format";
import { metresFrom } from "./maths";
import { drawTrack, type Point } from "./track";

/** Points drawn at most: a cell of 200 px shows no more. */
const POINTS = 400;
/** Receivers without a fix send the largest number there is for an accuracy. */
const UNKNOWN_M = 100_000;

export interface Position {
  readonly channel: Channel;
  readonly lat: number;
  readonly lon: number;
  readonly fix: number;
  readonly satellites: number;
  readonly horizontal: number;
  readonly vertical: number;
}

/** The channel with a latitude and a longitude; one that also tells the fix is preferred. */
export function positionOf(channels: readonly Channel[]): Position | undefined {
  const found = channels.flatMap((channel) => {
    const find = (pattern: RegExp): number => channel.info.columns.findIndex(({ name }) => pattern.test(name));
    const [lat, lon] = [find(/^lat/i), find(/^lon/i)];
    if (lat < 0 || lon < 0 || channel.info.kind === "rows") return [];
    const [fix, satellites] = [find(/^fix_?type$/i), find(/^num_?sv$/i)];
    return [{ channel, lat, lon, fix, satellites, horizontal: find(/^h_?acc$/i), vertical: find(/^v_?acc$/i) }];
  });
  return found.find((position) => position.fix >= 0) ?? found[0];
}

export function mountGnss(host: HTMLElement, deps: Deps, position: Position): Panel {
  const texts = { fix: new Live(), lat: new Live(), lon: new Live(), h: new Live(), v: new Live() };
  const canvas = el("canvas", { role: "img", "aria-label": "Track within the window, north up" });
  const accuracy = el("dd", {}, texts.h.node, unit("m h"), "\u2002", texts.v.node, unit("m v"));
  const list = el("dl", {}, el("dt", {}, "Lat"), el("dd", {}, texts.lat.node, unit("°")));
  list.append(el("dt", {}, "Lon"), el("dd", {}, texts.lon.node, unit("°")));
  if (position.horizontal >= 0 && position.vertical >= 0) list.append(el("dt", {}, "±"), accuracy);
  const cap = el("div", { class: "cap" }, el("span", {}, "GNSS track"), el("span", { class: "ell" }, texts.fix.node));
  const cell = el("div", { class: "gnss" }, cap, el("div", {}, canvas), list);
  host.append(cell);
  const to = surface(canvas, () => undefined);
  const due = every(5);
  return {
    update(frame) {
      if (!due(frame)) return;
      const at = reading(deps);
      const i = sampleAt(position.channel, at);
      writeTexts(position, i, texts);
      const { points, here } = track(position, at, i);
      drawTrack(to, points, here);
    },
    dispose() {
      to.dispose();
      cell.remove();
    },
  };
}

function writeTexts(position: Position, i: number, texts: Readonly<Record<"fix" | "lat" | "lon" | "h" | "v", Live>>): void {
  const { ring, info } = position.channel;
  const get = (column: number): number | undefined => (column < 0 || i < 0 ? undefined : ring.value(column, i));
  const [lat, lon] = [get(position.lat), get(position.lon)];
  const known = lat !== undefined && lon !== undefined && isPlace(lat, lon);
  texts.lat.set(geographic(known ? lat : undefined));
  texts.lon.set(geographic(known ? lon : undefined));
  texts.h.set(number(metres(position.horizontal), 2));
  texts.v.set(number(metres(position.vertical), 2));
  const fix = get(position.fix);
  const name = fix === undefined ? "" : (info.columns[position.fix]?.choices[String(fix)] ?? `fix ${fix}`);
  const satellites = get(position.satellites);
  texts.fix.set([name, satellites === undefined ? "" : `${satellites} sat`].filter(Boolean).join(" · ") || NONE);

  function metres(column: number): number | undefined {
    const value = get(column);
    const size = value !== undefined && info.columns[column]?.unit === "mm" ? value / 1000 : value;
    return size !== undefined && size < UNKNOWN_M ? size : undefined;
  }
}

/** True for what can be a place: a receiver without a fix sends zeros or nonsense. */
function isPlace(lat: number, lon: number): boolean {
  return Number.isFinite(lat + lon) && (lat !== 0 || lon !== 0) && Math.abs(lat) <= 90 && Math.abs(lon) <= 360;
}

function track(position: Position, at: Reading, here: number): { points: readonly (Point | undefined)[]; here: Point | undefined } {
  const { ring } = position.channel;
  const base = view.value.timeBase;
  const [first, last] = [Math.max(0, ring.indexAt(at.from, base)), ring.indexAt(at.to, base)];
  let origin: readonly [number, number] | undefined;
  const point = (i: number): Point | undefined => {
    const [lat, lon] = [ring.value(position.lat, i), ring.value(position.lon, i)];
    if (!isPlace(lat, lon)) return undefined;
    origin ??= [lat, lon];
    return metresFrom(origin, lat, lon);
  };
  const points: (Point | undefined)[] = [];
  const step = Math.max(1, Math.ceil((last - first + 1) / POINTS));
  for (let i = first; i <= last; i += step) points.push(point(i));
  return { points, here: here < 0 ? undefined : point(here) };
}
