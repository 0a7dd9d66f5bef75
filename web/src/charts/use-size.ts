/** Width and height of an element as signals, for what is drawn in pixels. */
import { type Signal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";

/** Until the size is known, px, and the least at which a chart can be read. */
const SIZES = { clientWidth: { first: 720, least: 240 }, clientHeight: { first: 220, least: 120 } } as const;

export const useWidth = (host: RefObject<HTMLElement | null>): Signal<number> => useSize(host, "clientWidth");
export const useHeight = (host: RefObject<HTMLElement | null>): Signal<number> => useSize(host, "clientHeight");

function useSize(host: RefObject<HTMLElement | null>, side: keyof typeof SIZES): Signal<number> {
  const size = useSignal<number>(SIZES[side].first);
  useEffect(() => {
    const element = host.current;
    if (!element) return undefined;
    const fit = (): void => {
      size.value = Math.max(SIZES[side].least, element[side] || size.peek());
    };
    fit();
    const resized = new ResizeObserver(fit);
    resized.observe(element);
    return () => resized.disconnect();
  }, [host, size, side]);
  return size;
}
