/** Files dropped anywhere on the page go into the library; by default a browser would leave the page and open them. */
import { signal } from "@preact/signals";
import { go, route } from "./route";
import { TEXT } from "../texts/live";

/** Files are over the page. */
const hovering = signal(false);

/** Whether files are dragged, not text of the page. */
export function bringsFiles(types: readonly string[] | undefined): boolean {
  return types?.includes("Files") ?? false;
}

/** Starts handling drops. Other handlers mark theirs by `preventDefault`. */
export function startDrop(): void {
  const isOurs = (event: DragEvent): boolean => !event.defaultPrevented && bringsFiles(event.dataTransfer?.types);
  window.addEventListener("dragover", (event) => {
    if (!isOurs(event)) return;
    event.preventDefault();
    hovering.value = true;
  });
  window.addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) hovering.value = false;
  });
  window.addEventListener("drop", (event) => {
    hovering.value = false;
    if (!isOurs(event)) return;
    event.preventDefault();
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length === 0) return;
    if (route.peek().page !== "recordings" || route.peek().recording !== undefined) go("recordings");
    void import("./recordings/library-store").then(({ add }) => add(files));
  });
}

/** Overlay with the effect of a drop, while files are dragged over the page. */
export function DropVeil() {
  if (!hovering.value) return null;
  return (
    <div class="drop-veil" role="status">
      <p>{TEXT.dropToAdd}</p>
    </div>
  );
}
