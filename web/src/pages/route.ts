/**
 * Routing by the part of the address after "#": a link opens its view, and Back goes back.
 *
 *     #/?device=…&span=…                    Live (pages/live-address.ts)
 *     #/configure/<device>/<place>/<more>   Configure; the place is a group, a setting, a command, or "compare", "corrections" …
 *     #/fleet?sort=…&show=…                 the robots of a fleet server (fleet/address.ts)
 *     #/recordings                          the library
 *     #/recordings/<id>?t0=…&cursor=…       a recording at the place of the link (recordings/permalink.ts)
 *     #/questions?sql=…                     questions about the store of the server, if it has one
 */
import { type Signal, signal } from "@preact/signals";
import type { IconName } from "../ui/icons";
import { COMMON } from "../texts/common";
import { TEXT as FLEET_TEXT } from "../texts/fleet-tab";
import { TEXT } from "../texts/live";

export type PageName = "fleet" | "live" | "configure" | "recordings" | "questions";

interface PageEntry {
  readonly name: PageName;
  readonly title: string;
  readonly icon: IconName;
}

/** The pages in order, with their names and icons. */
const PAGES: readonly PageEntry[] = [
  { name: "live", title: TEXT.live, icon: "wave" },
  { name: "configure", title: TEXT.configure, icon: "sliders" },
  { name: "recordings", title: COMMON.recordings, icon: "library" },
];
/** A fleet server has no device of its own. */
const FLEET: readonly PageEntry[] = [
  { name: "fleet", title: FLEET_TEXT.fleet, icon: "grid" },
  ...PAGES.filter(({ name }) => name === "recordings"),
];

const QUESTIONS: PageEntry = { name: "questions", title: COMMON.questions, icon: "search" };

interface ServerKind {
  readonly isFleet: Signal<boolean>;
  readonly hasStore: Signal<boolean>;
}

/** The pages of this server; one with a store of recordings answers questions about it. */
export const pagesOf = ({ isFleet, hasStore }: ServerKind): readonly PageEntry[] => [
  ...(isFleet.value ? FLEET : PAGES),
  ...(hasStore.value ? [QUESTIONS] : []),
];

export interface Route {
  readonly page: PageName;
  /** DeviceInfo.id, if the address names one. */
  readonly device: string | undefined;
  readonly place: string | undefined;
  readonly more: string | undefined;
  /** RecordingInfo.id, on the page of recordings. */
  readonly recording?: string | undefined;
  /** The part after "?". */
  readonly query?: string;
}

const LIVE: Route = { page: "live", device: undefined, place: undefined, more: undefined };

/** The route of an address's hash; undefined for others ("#plots" only moves the focus). */
export function parse(hash: string): Route | undefined {
  if (hash !== "" && hash !== "#" && !hash.startsWith("#/")) return undefined;
  const cut = hash.indexOf("?");
  const path = cut < 0 ? hash : hash.slice(0, cut);
  const [page, device, place, more] = path.slice(2).split("/").map(decoded);
  if (page === "fleet") return { ...LIVE, page, query: cut < 0 ? "" : hash.slice(cut + 1) };
  if (page === "recordings")
    return { ...LIVE, page, recording: device || undefined, query: cut < 0 ? "" : hash.slice(cut + 1) };
  if (page === "questions") return { ...LIVE, page, query: cut < 0 ? "" : hash.slice(cut + 1) };
  if (page !== "configure") return cut < 0 ? LIVE : { ...LIVE, query: hash.slice(cut + 1) };
  return { page, device: device || undefined, place: place || undefined, more: more || undefined };
}

function decoded(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part; // a stray "%" in a typed link
  }
}

/** The address of a page. */
export function href(page: PageName, ...parts: readonly (string | undefined)[]): string {
  if (page === "live") return "#/";
  const given = parts.slice(0, parts.includes(undefined) ? parts.indexOf(undefined) : parts.length);
  return ["#", page, ...given.map((part) => encodeURIComponent(part ?? ""))].join("/");
}

export const route = signal<Route>(parse(typeof location === "undefined" ? "" : location.hash) ?? LIVE);

/** Starts following the address. */
export function startRoute(): void {
  addEventListener("hashchange", () => {
    const next = parse(location.hash);
    if (next) route.value = next;
  });
}

export function go(page: PageName, ...parts: readonly (string | undefined)[]): void {
  location.hash = href(page, ...parts);
}
