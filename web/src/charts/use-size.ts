/** Width and height of an element as signals, for what is drawn in pixels. */
import { type Signal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";

const FIRST_PX = 720;
const MIN_PX = 240;

/** The width of `host`, px; not below the least at which a chart can be read. */
export function useWidth(host: RefObject<HTMLElement | null>): Signal<number> {
  return useSize(host, "clientWidth", FIRST_PX, MIN_PX);
}

function useSize(
  host: RefObject<HTMLElement | null>,
  side: "clientWidth" | "clientHeight",
  first: number,
  least: number,
): Signal<number> {
  const size = useSignal(first);
  useEffect(() => {
    const element = host.current;
    if (!element) return undefined;
    const fit = (): void => {
      size.value = Math.max(least, element[side] || size.peek());
    };
    fit();
    const resized = new ResizeObserver(fit);
    resized.observe(element);
    return () => resized.disconnect();
  }, [host, size, side, least]);
  return size;
}

const FIRST_HIGH_PX = 220;
const MIN_HIGH_PX = 120;

/** The height of `host`, px; not below the least at which a chart can be read. */
export function useHeight(host: RefObject<HTMLElement | null>): Signal<number> {
  return useSize(host, "clientHeight", FIRST_HIGH_PX, MIN_HIGH_PX);
}
