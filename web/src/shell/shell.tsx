/** The frame of all pages: the current page, the tabs of a phone, and notices shown on every page. */
import "../extensions/all";
import type { FunctionComponent } from "preact";
import { fromExtensions } from "../extension/extension";
import { Icon } from "../ui/controls/icons";
import { late } from "../ui/dom/late";
import type { App } from "../page/context";
import { LatePalette } from "../pages/dialogs";
import { LivePage } from "../pages/live";
import { openFiles } from "../pages/open-file";
import { href, type PageName, pagesOf, route } from "../page/route";
import { TEXT } from "../texts/live";
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

const loading = <div class="app" aria-busy="true" />;
const ConfigurePage = late(async () => (await import("../pages/configure/page")).ConfigurePage, loading);
const RecordingsPage = late(async () => (await import("../pages/recordings/page")).RecordingsPage, loading);
const Decks = late(async () => (await import("../pages/configure/rollback-banner")).Decks);

export function Shell({ app }: { readonly app: App }) {
  const { page } = route.value;
  const temporary = [...app.store.jobs.value.values()].some((jobs) => jobs.pending_rollback !== null);
  const special = fromExtensions("addresses").find(({ takes }) => takes(route.value));
  const Page = special?.View ?? fromExtensions("pages").find(({ name }) => name === page)?.View ?? viewOf(page);
  return (
    <>
      <Page app={app} />
      {temporary && <Decks app={app} />}
      <Tabs app={app} />
      <DropVeil app={app} />
      {app.overlay.value === "palette" && <LatePalette app={app} onClose={() => (app.overlay.value = undefined)} />}
    </>
  );
}

function viewOf(page: PageName): FunctionComponent<{ readonly app: App }> {
  if (page === "configure") return ConfigurePage;
  return page === "recordings" ? RecordingsPage : LivePage;
}

/** Navigation; the device stays the same. */
function Tabs({ app }: { readonly app: App }) {
  return (
    <nav class="tabs" aria-label={TEXT.pages}>
      {pagesOf(app).map(({ name, title, icon }) => (
        <a key={name} href={href(name)} {...(route.value.page === name ? { "aria-current": "page" as const } : {})}>
          <Icon name={icon} />
          {title}
        </a>
      ))}
    </nav>
  );
}

/** Whether files are dragged, not text of the page. */
function bringsFiles(types: readonly string[] | undefined): boolean {
  return types?.includes("Files") ?? false;
}

/**
 * Starts handling drops, until the returned function is called. Other handlers mark theirs by `preventDefault`.
 *
 * @param hover called with whether files are over the page
 */
function startDrop(app: App, hover: (files: boolean) => void): () => void {
  const stop = new AbortController();
  const isOurs = (event: DragEvent): boolean => !event.defaultPrevented && bringsFiles(event.dataTransfer?.types);
  const on = <K extends "dragover" | "dragleave" | "drop">(name: K, handle: (event: DragEvent) => void): void =>
    window.addEventListener(name, handle, { signal: stop.signal });
  on("dragover", (event) => {
    if (!isOurs(event)) return;
    event.preventDefault();
    hover(true);
  });
  on("dragleave", (event) => {
    if (event.relatedTarget === null) hover(false);
  });
  on("drop", (event) => {
    hover(false);
    if (!isOurs(event)) return;
    event.preventDefault();
    const files = [...(event.dataTransfer?.files ?? [])];
    openFiles(app, files);
  });
  return () => stop.abort();
}

/** Overlay with the effect of a drop, while files are dragged over the page. */
function DropVeil({ app }: { readonly app: App }) {
  const hovering = useSignal(false);
  useEffect(() => startDrop(app, (files) => (hovering.value = files)), [app]);
  if (!hovering.value) return null;
  return (
    <div class="drop-veil" role="status">
      <p>{TEXT.dropToAdd}</p>
    </div>
  );
}
