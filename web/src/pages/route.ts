/**
 * Which page is on screen? The part of the address after "#": a link opens what was looked at, and Back goes back.
 *
 *     #/                                    Live
 *     #/configure/<device>/<place>/<more>   Configure; the place is a group, a setting, a command, or "compare", "corrections" …
 */
import { signal } from "@preact/signals";

export type PageName = "live" | "configure";

export interface Route {
  readonly page: PageName;
  /** DeviceInfo.id, where the address names one. */
  readonly device: string | undefined;
  readonly place: string | undefined;
  readonly more: string | undefined;
}

/** What the hash of an address says; undefined where it is none of ours ("#plots" only moves the focus). */
export function parse(hash: string): Route | undefined {
  if (hash !== "" && hash !== "#" && !hash.startsWith("#/")) return undefined;
  const [page, device, place, more] = hash.slice(2).split("/").map(decoded);
  if (page !== "configure") return { page: "live", device: undefined, place: undefined, more: undefined };
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

export const route = signal<Route>(parse(typeof location === "undefined" ? "" : location.hash) ?? { page: "live", device: undefined, place: undefined, more: undefined });

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
