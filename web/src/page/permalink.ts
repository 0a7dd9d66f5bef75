/**
 * Content of a link to a recording, or to Live: the range on screen, both cursors, the device, the clock, the frame, the series hidden
 * and shown, the further plots, and those put together by the user. Times are unix seconds to 0.1 ms; nothing of it is stored on the server.
 *
 *     #/recordings/<id>?t0=1732191845.2&t1=1732191865.2&cursor=1732191850.125&loop=…,…&speed=4&device=1&base=arrival&frame=NED&hide=…&show=…&panels=…&plot=…&workspace=…
 */
import type { WorldFrame } from "../data/rotations";
import type { CustomPlot } from "../data/view";
import { href } from "./route";
import { plotsOfWords, plotWord } from "../signals/custom-plots";

export interface LinkedPlace {
  readonly t0?: number;
  readonly t1?: number;
  /** Length of a window that follows the newest sample, s. */
  readonly span?: number;
  readonly cursor?: number;
  readonly measure?: number;
  readonly loop?: readonly [number, number];
  /** Of playback, recorded seconds per second; absent: 1. */
  readonly speed?: number;
  readonly device?: string;
  readonly base?: "device" | "arrival";
  readonly frame?: WorldFrame;
  /** Keys of hidden series, of shown norms (hidden by default), and of further plots. */
  readonly hide: readonly string[];
  readonly show: readonly string[];
  readonly panels: readonly string[];
  /** Plots put together by the user. */
  readonly plots?: readonly CustomPlot[];
  /** Further parts of the workspace as JSON (workspace/parts.ts). */
  readonly workspace?: string;
}

/** Decimals of a second: finer than any sensor's sampling. */
const URL_DIGITS = 4;
const MAX_SPEED = 1000;
const FRAMES: readonly WorldFrame[] = ["ENU", "NED", "NWU"];

export function readPlace(query: string): LinkedPlace {
  const given = new URLSearchParams(query);
  const time = (name: string): number | undefined => {
    const value = Number(given.get(name) ?? NaN);
    return Number.isFinite(value) ? value : undefined;
  };
  const list = (name: string): readonly string[] =>
    given.get(name)?.split(",").filter(Boolean).map(decodeURIComponent) ?? [];
  const [t0, t1, cursor, measure, device, base] = [
    time("t0"),
    time("t1"),
    time("cursor"),
    time("measure"),
    given.get("device") ?? "",
    given.get("base"),
  ];
  const [span, speed] = [Number(given.get("span") ?? NaN), Number(given.get("speed") ?? NaN)];
  const frame = FRAMES.find((name) => name === given.get("frame"));
  const plots = plotsOfWords(given.getAll("plot"));
  const loop = (given.get("loop") ?? "").split(",").map(Number);
  const [a, b] = loop;
  return {
    ...(t0 !== undefined && t1 !== undefined && t1 > t0 ? { t0, t1 } : {}),
    ...(span > 0 && Number.isFinite(span) ? { span } : {}),
    ...(speed > 0 && speed <= MAX_SPEED ? { speed } : {}),
    ...(cursor !== undefined ? { cursor } : {}),
    ...(measure !== undefined ? { measure } : {}),
    ...(loop.length === 2 && a !== undefined && b !== undefined && b > a ? { loop: [a, b] as const } : {}),
    ...(device ? { device } : {}),
    ...(base === "device" || base === "arrival" ? { base } : {}),
    ...(frame ? { frame } : {}),
    ...(plots.length > 0 ? { plots } : {}),
    ...(given.get("workspace") ? { workspace: given.get("workspace") ?? "" } : {}),
    hide: safely(() => list("hide")),
    show: safely(() => list("show")),
    panels: safely(() => list("panels")),
  };
}

/** A list in a link that may be cut or mistyped. */
function safely(read: () => readonly string[]): readonly string[] {
  try {
    return read();
  } catch {
    return [];
  }
}

export function placeQuery(place: LinkedPlace): string {
  const given = new URLSearchParams();
  const time = (name: string, value: number | undefined): void => {
    if (value !== undefined) given.set(name, value.toFixed(URL_DIGITS));
  };
  time("t0", place.t0);
  time("t1", place.t1);
  if (place.span !== undefined) given.set("span", String(Number(place.span.toFixed(URL_DIGITS))));
  time("cursor", place.cursor);
  time("measure", place.measure);
  if (place.loop) given.set("loop", place.loop.map((t) => t.toFixed(URL_DIGITS)).join(","));
  if (place.speed !== undefined) given.set("speed", String(place.speed));
  if (place.device) given.set("device", place.device);
  if (place.base === "arrival") given.set("base", place.base);
  if (place.frame) given.set("frame", place.frame);
  for (const name of ["hide", "show", "panels"] as const) {
    if (place[name].length > 0) given.set(name, place[name].map((key) => encodeURIComponent(key)).join(","));
  }
  for (const plot of place.plots ?? []) given.append("plot", plotWord(plot));
  if (place.workspace) given.set("workspace", place.workspace);
  return given.toString();
}

/** The hash of a link to a place in a recording. */
export function placeHref(id: string, place: LinkedPlace): string {
  const query = placeQuery(place);
  return href("recordings", id) + (query ? `?${query}` : "");
}

/** The part of the hidden series stored in a link: norms are hidden by default, so their shown ones are listed. */
export function seriesOf(hidden: ReadonlySet<string>, norms: ReadonlySet<string>): Pick<LinkedPlace, "hide" | "show"> {
  return { hide: [...hidden].filter((key) => !norms.has(key)), show: [...norms].filter((key) => !hidden.has(key)) };
}

/** The hidden series of a link. Norms that it shows count as known, so that they are not hidden when first seen. */
export function takeSeries(
  { hide, show }: Pick<LinkedPlace, "hide" | "show">,
  norms: Set<string>,
): ReadonlySet<string> {
  for (const key of show) norms.add(key);
  return new Set([...hide, ...[...norms].filter((key) => !show.includes(key))]);
}
