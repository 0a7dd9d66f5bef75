/** Dragging a signal of the tree onto a plot, or under the plots for a new one. */

const TYPE = "application/x-imuscope-signal";

/** @param key of the row */
export function beginDrag(event: DragEvent, key: string): void {
  if (!event.dataTransfer) return;
  event.dataTransfer.setData(TYPE, key);
  event.dataTransfer.effectAllowed = "copy";
}

/**
 * Listen on a page; the returned function stops.
 *
 * @param dropped called with the key of the row, and of the plot: undefined beside the plots
 */
export function listenForDrops(
  page: HTMLElement,
  dropped: (row: string, plot: string | undefined) => void,
): () => void {
  const stop = new AbortController();
  let marked: Element | null = null;
  const mark = (plot: Element | null): void => {
    if (plot === marked) return;
    marked?.classList.remove("drop-target");
    plot?.classList.add("drop-target");
    marked = plot;
  };
  const placeOf = (event: DragEvent): Element | null => {
    const target = event.target instanceof Element ? event.target : null;
    if (!event.dataTransfer?.types.includes(TYPE)) return null;
    return target?.closest(".plot") ?? target?.closest(".stack") ?? null;
  };
  page.addEventListener(
    "dragover",
    (event) => {
      const place = placeOf(event);
      mark(place);
      if (!place || !event.dataTransfer) return;
      event.preventDefault();
      event.dataTransfer.dropEffect = "copy";
    },
    { signal: stop.signal },
  );
  page.addEventListener(
    "drop",
    (event) => {
      const place = placeOf(event);
      if (place && event.dataTransfer) {
        event.preventDefault();
        dropped(event.dataTransfer.getData(TYPE), place.getAttribute("data-key") ?? undefined);
      }
      mark(null);
    },
    { signal: stop.signal },
  );
  page.addEventListener("dragend", () => mark(null), { signal: stop.signal });
  return () => {
    mark(null);
    stop.abort();
  };
}
