/**
 * Which page is on screen? The part of the address after "#": a link opens what was looked at, and Back goes back.
 *
 *     #/?device=…&span=…                    Live, as the link says (pages/live-address.ts)
 *     #/configure/<device>/<place>/<more>   Configure; the place is a group, a setting, a command, or "compare", "corrections" …
 *     #/recordings                          the library
 *     #/recordings/<id>?t0=…&cursor=…       a recording, opened where the link says (recordings/permalink.ts)
 */
import { signal } from "@preact/signals";
import type { IconName } from "../ui/icons";

export type PageName = "live" | "configure" | "recordings";

/** The pages in their order, with their names for a person and their pictograms. */
export const PAGES = [
  { name: "live", title: "Live", icon: "wave" },
  { name: "configure", title: "Configure", icon: "sliders" },
  { name: "recordings", title: "Recordings", icon: "library" },
] as const satisfies readonly { readonly name: PageName; readonly title: string; readonly icon: IconName }[];

export interface Route {
  readonly page: PageName;
  /** DeviceInfo.id, where the address names one. */
  readonly device: string | undefined;
  readonly place: string | undefined;
  readonly more: string | undefined;
  /** RecordingInfo.id, on the page of recordings. */
  readonly recording?: string | undefined;
  /** What follows "?", without it. */
  readonly query?: string;
}

const LIVE: Route = { page: "live", device: undefined, place: undefined, more: undefined };

/** What the hash of an address says; undefined where it is none of ours ("#plots" only moves the focus). */
export function parse(hash: string): Route | undefined {
  if (hash !== "" && hash !== "#" && !hash.startsWith("#/")) return undefined;
  const cut = hash.indexOf("?");
  const path = cut < 0 ? hash : hash.slice(0, cut);
  const [page, device, place, more] = path.slice(2).split("/").map(decoded);
  if (page === "recordings") return { ...LIVE, page, recording: device || undefined, query: cut < 0 ? "" : hash.slice(cut + 1) };
  if (page !== "configure") return cut < 0 ? LIVE : { ...LIVE, query: hash.slice(cut + 1) };
  return { page, device: device || undefined, place: place || undefined, more: more || undefined };
}

function decoded(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part; // a stray "%" in a link that was typed
  }
}

/** The address of a page. */
export function href(page: PageName, ...parts: readonly (string | undefined)[]): string {
  if (page === "live") return "#/";
  const given = parts.slice(0, parts.findIndex((part) => part === undefined) < 0 ? parts.length : parts.indexOf(undefined));
  return ["#", page, ...given.map((part) => encodeURIComponent(part ?? ""))].join("/");
}

export const route = signal<Route>(parse(typeof location === "undefined" ? "" : location.hash) ?? LIVE);

/** Follows the address from here on. */
export function startRoute(): void {
  addEventListener("hashchange", () => {
    const next = parse(location.hash);
    if (next) route.value = next;
  });
}

export function go(page: PageName, ...parts: readonly (string | undefined)[]): void {
  location.hash = href(page, ...parts);
}
