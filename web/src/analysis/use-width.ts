/** Width of an element as a signal, for what is drawn in pixels. */
import { type Signal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";

const FIRST_PX = 720;
const MIN_PX = 240;

/** The width of `host`, px; not below the least at which a chart can be read. */
export function useWidth(host: RefObject<HTMLElement | null>): Signal<number> {
  const width = useSignal(FIRST_PX);
  useEffect(() => {
    const element = host.current;
    if (!element) return undefined;
    const fit = (): void => {
      width.value = Math.max(MIN_PX, element.clientWidth || width.peek());
    };
    fit();
    const resized = new ResizeObserver(fit);
    resized.observe(element);
    return () => resized.disconnect();
  }, [host, width]);
  return width;
}
