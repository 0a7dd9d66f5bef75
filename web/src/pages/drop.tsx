/** Files dropped anywhere on the page go into the library; by default a browser would leave the page and open them. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { App } from "../page/context";
import { go, route } from "../page/route";
import { TEXT } from "../texts/live";

/** Whether files are dragged, not text of the page. */
export function bringsFiles(types: readonly string[] | undefined): boolean {
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
    if (files.length === 0) return;
    if (route.peek().page !== "recordings" || route.peek().recording !== undefined) go("recordings");
    void import("./recordings/library-store").then(({ libraryOf }) => libraryOf(app).add(files));
  });
  return () => stop.abort();
}

/** Overlay with the effect of a drop, while files are dragged over the page. */
export function DropVeil({ app }: { readonly app: App }) {
  const hovering = useSignal(false);
  useEffect(() => startDrop(app, (files) => (hovering.value = files)), [app]);
  if (!hovering.value) return null;
  return (
    <div class="drop-veil" role="status">
      <p>{TEXT.dropToAdd}</p>
    </div>
  );
}
