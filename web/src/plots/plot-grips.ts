/**
 * Grips of a plot for the mouse: its title moves it among the plots, its lower edge sets its height, and a double click on the edge gives
 * the height back. The workspace has the same for keyboard and touch (workspace/arrange.tsx).
 */
import type { ViewState } from "../data/view-state";
import { el } from "../ui/dom/dom";
import type { Plot } from "./plot";
import { movedTo, withHeight } from "../data/plot-order";
import { TEXT } from "../texts/plots";
import "./plot-grips.css";

/** A press on the title that moved less than this moves nothing, px. */
const CLICK_PX = 5;

/** Follows a plot that is dragged; true where it would leave its tile. */
export type DragOut = (key: string) => {
  readonly move: (to: PointerEvent) => boolean;
  /** True if it has left. */
  readonly drop: (isDropped: boolean) => boolean;
};

/** @param all the plots on screen, in their order */
export function addGrips(
  plot: Plot,
  { plotOrder }: Pick<ViewState, "plotOrder">,
  all: () => readonly Plot[],
  dragOut?: DragOut,
): void {
  const { root, spec, legend } = plot;
  const edge = el("div", { class: "plot-edge", title: TEXT.heightHint });
  root.append(edge);
  hold(edge, (from) => {
    const height = root.offsetHeight;
    return {
      move: (to) => void (plotOrder.value = withHeight(plotOrder.peek(), spec.key, height + to.clientY - from.clientY)),
      drop: () => {},
    };
  });
  edge.addEventListener("dblclick", (event) => {
    event.stopPropagation();
    plotOrder.value = withHeight(plotOrder.peek(), spec.key, undefined);
  });
  const title = legend.root.querySelector("b");
  if (title === null) return;
  title.classList.add("plot-title");
  title.title = [title.title, TEXT.moveHint].filter(Boolean).join("\n");
  hold(title, (from) => {
    let at: number | undefined;
    const out = dragOut?.(spec.key);
    const mark = (to: Plot | undefined, side: "before" | "after"): void => {
      for (const one of all()) one.root.classList.remove("drop-before", "drop-after");
      to?.root.classList.add(`drop-${side}`);
    };
    return {
      move(to) {
        if (at === undefined && Math.hypot(to.clientX - from.clientX, to.clientY - from.clientY) < CLICK_PX) return;
        root.classList.add("dragged");
        if (out?.move(to)) {
          at = undefined;
          return mark(undefined, "before");
        }
        const others = all().filter((one) => one !== plot);
        const below = others.findIndex((one) => {
          const { top, height } = one.root.getBoundingClientRect();
          return to.clientY < top + height / 2;
        });
        at = below < 0 ? others.length : below;
        mark(others[at] ?? others.at(-1), below < 0 ? "after" : "before");
      },
      drop(isDropped) {
        root.classList.remove("dragged");
        mark(undefined, "before");
        if (out?.drop(isDropped)) return;
        const keys = all().map((one) => one.spec.key);
        if (isDropped && at !== undefined) plotOrder.value = movedTo(plotOrder.peek(), keys, spec.key, at);
      },
    };
  });
}

interface Drag {
  readonly move: (to: PointerEvent) => void;
  readonly drop: (isDropped: boolean) => void;
}

/** Drag an element by mouse; a finger scrolls the page. */
function hold(element: HTMLElement, begin: (from: PointerEvent) => Drag): void {
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || event.pointerType === "touch") return;
    event.stopPropagation();
    event.preventDefault();
    element.setPointerCapture(event.pointerId);
    const drag = begin(event);
    const stop = new AbortController();
    const { signal } = stop;
    const end = (isDropped: boolean) => (): void => {
      stop.abort();
      drag.drop(isDropped);
    };
    element.addEventListener("pointermove", drag.move, { signal });
    element.addEventListener("pointerup", end(true), { signal });
    element.addEventListener("pointercancel", end(false), { signal });
  });
}
