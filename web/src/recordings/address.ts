/**
 * What does a link to a recording carry? The recording, the range on screen, the cursor, the device, the clock, the series hidden and
 * the further plots asked for. Times are unix seconds to 0.1 ms; nothing of it is kept on the server.
 *
 *     #/recordings/<id>?t0=1732191845.2&t1=1732191865.2&cursor=1732191850.125&loop=…,…&device=1&base=arrival&hide=…&panels=…
 */
import { href } from "../pages/route";

export interface Place {
  readonly t0?: number;
  readonly t1?: number;
  readonly cursor?: number;
  readonly loop?: readonly [number, number];
  readonly device?: string;
  readonly base?: "device" | "arrival";
  /** Keys of series that are hidden, and of further plots that are shown. */
  readonly hide: readonly string[];
  readonly panels: readonly string[];
}

/** Digits after the point of a second: finer than any sensor's sampling. */
const DIGITS = 4;

export function readPlace(query: string): Place {
  const given = new URLSearchParams(query);
  const time = (name: string): number | undefined => {
    const value = Number(given.get(name) ?? NaN);
    return Number.isFinite(value) ? value : undefined;
  };
  const list = (name: string): readonly string[] => given.get(name)?.split(",").filter(Boolean).map(decodeURIComponent) ?? [];
  const [t0, t1, cursor, device, base] = [time("t0"), time("t1"), time("cursor"), given.get("device") ?? "", given.get("base")];
  const loop = (given.get("loop") ?? "").split(",").map(Number);
  const [a, b] = loop;
  return {
    ...(t0 !== undefined && t1 !== undefined && t1 > t0 ? { t0, t1 } : {}),
    ...(cursor !== undefined ? { cursor } : {}),
    ...(loop.length === 2 && a !== undefined && b !== undefined && b > a ? { loop: [a, b] as const } : {}),
    ...(device ? { device } : {}),
    ...(base === "device" || base === "arrival" ? { base } : {}),
    hide: safely(() => list("hide")),
    panels: safely(() => list("panels")),
  };
}

/** A list in a link that was cut or typed. */
function safely(read: () => readonly string[]): readonly string[] {
  try {
    return read();
  } catch {
    return [];
  }
}

/** The hash of a link to a place in a recording. */
export function placeHref(id: string, place: Place): string {
  const given = new URLSearchParams();
  const time = (name: string, value: number | undefined): void => {
    if (value !== undefined) given.set(name, value.toFixed(DIGITS));
  };
  time("t0", place.t0);
  time("t1", place.t1);
  time("cursor", place.cursor);
  if (place.loop) given.set("loop", place.loop.map((t) => t.toFixed(DIGITS)).join(","));
  if (place.device) given.set("device", place.device);
  if (place.base === "arrival") given.set("base", place.base);
  for (const name of ["hide", "panels"] as const) {
    if (place[name].length > 0) given.set(name, place[name].map((key) => encodeURIComponent(key)).join(","));
  }
  const query = given.toString();
  return href("recordings", id) + (query ? `?${query}` : "");
}
