/** Files dropped anywhere on the page go into the library: a browser left to itself would leave the page and open them. */
import { signal } from "@preact/signals";
import { go, route } from "./route";

/** Files are over the page. */
const hovering = signal(false);

/** Is it files that are dragged? Words of the page itself are not ours. */
export function bringsFiles(types: readonly string[] | undefined): boolean {
  return types?.includes("Files") ?? false;
}

/** Takes them from here on. What handles a drop by itself says so with `preventDefault`. */
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

/** What a drop would do, over everything while files are held. */
export function DropVeil() {
  if (!hovering.value) return null;
  return (
    <div class="dropveil" role="status">
      <p>Drop to add to the recordings</p>
    </div>
  );
}
