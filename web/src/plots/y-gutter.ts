/**
 * The labels of a plot's y axis as a control: the wheel zooms the axis about the pointer, a drag moves it, two fingers zoom it, a
 * double click makes it automatic again, and a click, Enter or a tap opens the form for a typed range. ↑ and ↓ move it, + and − zoom.
 */
import { el } from "../ui/dom/dom";
import type { ViewSignals, YAxis } from "../data/view";
import { figure } from "../charts/axes";
import { shifted, type YRange, zoomed } from "./y-axis";
import { TEXT } from "../texts/plots";
import "./y-axis.css";

/** Change of the range per px of wheel. */
const ZOOM_PER_PX = 0.0015;
/** One press of a key zooms by this factor, and moves by this share. */
const [KEY_ZOOM, KEY_MOVE] = [1.25, 0.1];
const CLICK_PX = 4;
/** A second click within this makes a double click, ms. */
const DOUBLE_MS = 280;

/** The axis as drawn last: its range, and its place in the control, px. */
export interface DrawnAxis {
  readonly range: YRange;
  readonly isLog: boolean;
  readonly top: number;
  readonly height: number;
}

/** The axis that a control is for; its key is that of its choice. */
export interface GutterSpec {
  readonly key: string;
  readonly title: string;
  readonly unit: string;
}

/** State of the view that an axis reads and writes. */
export type AxisState = Pick<ViewSignals, "yAxes" | "yAxisForm">;

/** @param drawn the axis as drawn; undefined before the first frame */
export function yGutter(spec: GutterSpec, state: AxisState, drawn: () => DrawnAxis | undefined): HTMLButtonElement {
  const mark = el("span", { class: "y-mark" });
  const button = el("button", { type: "button", class: "y-gutter", title: TEXT.yAxisHint }, mark);
  const fingers = new Map<number, number>();
  let press: { readonly y: number; readonly axis: DrawnAxis; moved: boolean } | undefined;
  let opening: ReturnType<typeof setTimeout> | undefined;
  const set = (range: YRange | undefined): void => {
    const { isLog } = state.yAxes.peek().get(spec.key) ?? {};
    setYAxis(state, spec.key, { ...(isLog ? { isLog } : {}), ...(range ? { range } : {}) });
  };
  const yIn = (event: MouseEvent): number => event.clientY - button.getBoundingClientRect().top;
  const shareAt = (axis: DrawnAxis, y: number): number =>
    Math.min(1, Math.max(0, 1 - (y + button.offsetTop - axis.top) / axis.height));
  const open = (): void => {
    const axis = drawn();
    if (axis) state.yAxisForm.value = { key: spec.key, range: axis.range };
  };
  button.addEventListener(
    "wheel",
    (event) => {
      const axis = drawn();
      if (axis === undefined || event.deltaY === 0) return;
      event.preventDefault();
      const size = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
      set(zoomed(axis.range, Math.exp(event.deltaY * size * ZOOM_PER_PX), shareAt(axis, yIn(event)), axis.isLog));
    },
    { passive: false },
  );
  button.addEventListener("mousedown", (event) => event.preventDefault()); // without focus: Space still pauses
  button.addEventListener("pointerdown", (event) => {
    const axis = drawn();
    fingers.set(event.pointerId, yIn(event));
    if (axis === undefined || event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    press = { y: yIn(event), axis, moved: fingers.size > 1 };
  });
  button.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = [...fingers.values()];
    fingers.set(event.pointerId, yIn(event));
    const axis = drawn();
    if (before.length === 2 && axis) {
      const spread = ([a = 0, b = 0]: readonly number[]): number => Math.max(12, Math.abs(a - b));
      const after = [...fingers.values()];
      const middle = ((after[0] ?? 0) + (after[1] ?? 0)) / 2;
      set(zoomed(axis.range, spread(before) / spread(after), shareAt(axis, middle), axis.isLog));
      return;
    }
    if (press === undefined || event.pointerType === "touch") return; // one finger scrolls the page
    const moved = yIn(event) - press.y;
    if (!press.moved && Math.abs(moved) < CLICK_PX) return;
    press.moved = true;
    set(shifted(press.axis.range, moved / press.axis.height, press.axis.isLog));
  });
  const end = (event: PointerEvent): void => void fingers.delete(event.pointerId);
  button.addEventListener("pointerup", end);
  button.addEventListener("pointercancel", end);
  button.addEventListener("click", (event) => {
    const wasMoved = press?.moved === true;
    press = undefined;
    clearTimeout(opening);
    if (event.detail === 0) open();
    else if (!wasMoved && event.detail === 1) opening = setTimeout(open, DOUBLE_MS);
  });
  button.addEventListener("dblclick", () => {
    clearTimeout(opening);
    set(undefined);
  });
  button.addEventListener("keydown", (event) => {
    const axis = drawn();
    const [zoom, move] = KEYS[event.key] ?? [1, 0];
    if (axis === undefined || !(event.key in KEYS) || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    set(move === 0 ? zoomed(axis.range, zoom, 0.5, axis.isLog) : shifted(axis.range, move, axis.isLog));
  });
  return button;
}

const KEYS: Readonly<Record<string, readonly [zoom: number, move: number]>> = {
  ArrowUp: [1, KEY_MOVE],
  ArrowDown: [1, -KEY_MOVE],
  "+": [1 / KEY_ZOOM, 0],
  "-": [KEY_ZOOM, 0],
};

/** Show in the control what was chosen. */
export function showAxis(button: HTMLButtonElement, spec: GutterSpec, axis: YAxis | undefined): void {
  const range = axis?.range?.map((value) => figure(value));
  const words = range
    ? TEXT.yAxisFixed(spec.title, range[0] ?? "", range[1] ?? "", spec.unit)
    : TEXT.yAxisAutomatic(spec.title);
  button.setAttribute("aria-label", axis?.isLog ? `${words}, ${TEXT.logarithmic}` : words);
  if (button.firstElementChild)
    button.firstElementChild.textContent = [range && TEXT.fixed, axis?.isLog && TEXT.log].filter(Boolean).join(" ");
}

/** Choose an axis; one with nothing chosen follows the data. */
export function setYAxis({ yAxes }: Pick<AxisState, "yAxes">, key: string, axis: YAxis): void {
  const next = new Map(yAxes.peek());
  if (axis.range === undefined && axis.isLog !== true) next.delete(key);
  else next.set(key, axis);
  yAxes.value = next;
}
