/**
 * A row that gives way when it is full: step by step, until what remains has room.
 *
 * The steps done are in `data-full`, "1 2 3" after three; what a step hides is written in a style sheet, as
 * `[data-full~="3"] .words`. Measured, not derived from the width of the window: what stands in the row changes with
 * the page, the device, and whether it records.
 */
import type { RefObject } from "preact";
import { useLayoutEffect } from "preact/hooks";

/** @param steps how many there are in the style sheet */
export function useFit(row: RefObject<HTMLElement | null>, steps: number): void {
  useLayoutEffect(() => {
    const element = row.current;
    if (!element) return undefined;
    const isFull = (): boolean => element.scrollWidth > element.clientWidth;
    let done = 0;
    const give = (wanted: number): void => {
      done = wanted;
      element.dataset.full = Array.from({ length: wanted }, (_, i) => i + 1).join(" ");
    };
    const giveWay = (): void => {
      while (done < steps && isFull()) give(done + 1);
    };
    const fit = (): void => {
      give(0);
      giveWay();
    };
    // changed words may need more room; only what comes or goes can make some
    const changed = new MutationObserver((changes) =>
      changes.some(({ type }) => type === "childList") ? fit() : giveWay(),
    );
    const resized = new ResizeObserver(fit);
    changed.observe(element, { childList: true, characterData: true, subtree: true });
    resized.observe(element);
    void document.fonts?.ready.then(fit);
    return () => {
      changed.disconnect();
      resized.disconnect();
    };
  }, [row, steps]);
}
