/**
 * Routing by the part of the address after "#": a link opens its view, and Back goes back.
 *
 *     #/?device=…&span=…                    Live (pages/live-address.ts)
 *     #/configure/<device>/<place>/<more>   Configure; the place is a group, a setting, a command, or "compare", "corrections" …
 *     #/recordings                          the library
 *     #/recordings/<id>?t0=…&cursor=…       a recording at the place of the link (page/permalink.ts)
 *     #/<name>?…                            a page of an extension, which reads the query itself (extension/extension.tsx)
 */
import type { FunctionComponent } from "preact";
import { signal } from "@preact/signals";
import { fromExtensions } from "../extension/extension";
import type { IconName } from "../ui/controls/icons";
import type { App } from "./context";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";

/** A page, "#/NAME?…" in the address. */
export interface ExtensionPage extends PageEntry {
  /**
   * It shows other hosts, and a server that offers it has no device of its own: it then takes the place of Live and Configure. Nothing is
   * recorded from it.
   */
  readonly isRemote?: boolean;
  /** Whether the navigation leads to it. Reads signals. */
  readonly isOffered: (app: App) => boolean;
  readonly View: FunctionComponent<{ readonly app: App }>;
}

/** A page at certain addresses of another one. */
export interface ExtensionAddress {
  readonly takes: (route: Route) => boolean;
  readonly View: FunctionComponent<{ readonly app: App }>;
}

declare module "../extension/extension" {
  interface Extension {
    readonly pages?: readonly ExtensionPage[];
    readonly addresses?: readonly ExtensionAddress[];
  }
}

/** "live", "configure", "recordings", or the name of an extension's page. */
export type PageName = string;

export interface PageEntry {
  readonly name: PageName;
  readonly title: string;
  readonly icon: IconName;
}

const PAGES: readonly PageEntry[] = [
  { name: "live", title: TEXT.live, icon: "wave" },
  { name: "configure", title: TEXT.configure, icon: "sliders" },
  { name: "recordings", title: COMMON.recordings, icon: "library" },
];

/** The pages that the navigation leads to. Reads signals. */
export function pagesOf(app: App): readonly PageEntry[] {
  const offered = fromExtensions("pages").filter(({ isOffered }) => isOffered(app));
  const remote = offered.filter(({ isRemote }) => isRemote === true);
  const local = offered.filter(({ isRemote }) => isRemote !== true);
  return [...remote, ...PAGES.filter(({ name }) => remote.length === 0 || name === "recordings"), ...local];
}

/** Whether a page shows other hosts than this server's. */
export const isRemote = (page: PageName): boolean =>
  fromExtensions("pages").some((one) => one.name === page && one.isRemote === true);

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
  if (page === "recordings")
    return { ...LIVE, page, recording: device || undefined, query: cut < 0 ? "" : hash.slice(cut + 1) };
  if (page !== undefined && fromExtensions("pages").some(({ name }) => name === page))
    return { ...LIVE, page, query: cut < 0 ? "" : hash.slice(cut + 1) };
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

/** Counts how often the open recording changed as a whole: its page starts over. */
export const reopened = signal(0);
/** Starts following the address. */
export function startRoute(): void {
  const named = location.pathname.split("/").at(-1) ?? ""; // typed without "#": /configure
  if (location.hash === "" && PAGES.some(({ name }) => name === named)) history.replaceState(null, "", `./#/${named}`);
  route.value = parse(location.hash) ?? LIVE; // pages of extensions are known by now
  addEventListener("hashchange", () => {
    const next = parse(location.hash);
    if (next) route.value = next;
  });
}

export function go(page: PageName, ...parts: readonly (string | undefined)[]): void {
  location.hash = href(page, ...parts);
}
