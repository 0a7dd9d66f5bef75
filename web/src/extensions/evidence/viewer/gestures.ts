/** Wheel, dragging and pinching over a plot: zoom and move; a click or a dragged handle sets a cursor. */
import { LEFT, RIGHT } from "./drawing";
import type { EvidenceViewer } from "./viewer";

const SLACK_PX = 5;
const NEAR_PX = 9;
const STEP = 1.0015; // of zoom for each pixel of the wheel

export function listenTo(canvas: HTMLCanvasElement, viewer: EvidenceViewer, plot: number): void {
  const fraction = (clientX: number): number => {
    const box = canvas.getBoundingClientRect();
    return (clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
  };
  const touches = new Map<number, number>();
  let began: { readonly x: number; readonly from: number; readonly to: number } | undefined;
  let held: "a" | "b" | undefined;
  let moved = false;
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY))
        viewer.pan((event.deltaX || event.deltaY) / 800);
      else viewer.zoom(STEP ** event.deltaY, fraction(event.clientX));
    },
    { passive: false },
  );
  const start = (event: PointerEvent): void => {
    const { from, to } = viewer.shown;
    began = { x: event.clientX, from, to };
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    touches.set(event.pointerId, event.clientX);
    moved = touches.size > 1;
    start(event);
    const near = NEAR_PX / canvas.getBoundingClientRect().width;
    held = touches.size === 1 ? viewer.cursorNear(fraction(event.clientX), near) : undefined;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = touches.get(event.pointerId);
    if (before === undefined || began === undefined) return;
    if (touches.size === 2) {
      const [other] = [...touches].flatMap(([id, x]) => (id === event.pointerId ? [] : [x]));
      touches.set(event.pointerId, event.clientX);
      if (other === undefined) return;
      const [was, is] = [Math.abs(before - other), Math.abs(event.clientX - other)];
      if (was > 8 && is > 8) viewer.zoom(was / is, fraction((event.clientX + other) / 2));
      return;
    }
    touches.set(event.pointerId, event.clientX);
    moved ||= Math.abs(event.clientX - began.x) > SLACK_PX;
    if (!moved) return;
    if (held !== undefined) viewer.setCursor(held, viewer.timeAt(fraction(event.clientX)), plot);
    else viewer.show(began.from, began.to, fraction(began.x) - fraction(event.clientX));
  });
  const end = (event: PointerEvent): void => {
    if (!touches.delete(event.pointerId)) return;
    const [rest] = touches.values();
    if (rest !== undefined) began = { x: rest, from: viewer.shown.from, to: viewer.shown.to };
    else if (!moved && event.type === "pointerup")
      viewer.setCursor(event.shiftKey ? "b" : viewer.sets, viewer.timeAt(fraction(event.clientX)), plot);
    if (rest === undefined) began = held = undefined;
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("dblclick", () => viewer.whole());
}
