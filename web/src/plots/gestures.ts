/**
 * Pointer and touch gestures on the plots. They call the actions; nothing here draws.
 *
 *     move            the cursor follows (mouse)          drag           pans, and pauses by itself
 *     click, tap      pins the cursor there               shift + drag   selects a range
 *     shift + click   pins the measuring cursor           double click   fits
 *     right click     shows the frame that made the sample
 *     wheel           zooms about the pointer             two fingers    zoom and pan
 *     click on the time of a cursor beside the window     goes there
 *
 *     drag on a cursor  moves it: A the pinned one, B the measuring one
 *     a finger that rests pins the measuring cursor
 *
 * One finger moves along time; vertically it scrolls the page, which `touch-action: pan-y` leaves to the browser.
 */
import type { ViewState } from "../data/view-state";
import { timeAt, xOf, type TimeWindow } from "./time-window";

/** A press that moved less than this is a click, px. */
const CLICK_PX = 4;
/** A click this near to the pin removes it, px. */
const UNPIN_PX = 5;
/** A drag that begins this near to a cursor moves the cursor, px; and with a finger. */
const GRIP_PX = 5;
const FINGER_PX = 16;
/** Change of the window's length per px of wheel: a notch of 100 px is about 15 %. */
const WHEEL_STEP = 0.0015;
/** Dragging the box of the strip to within this fraction of its end goes live again. */
const LIVE_ZONE = 0.012;
/** Width of the label of an off-screen cursor on the axis: a click on it goes there, px. */
const BESIDE_PX = 120;
/** A finger that rests this long measures, ms. */
const REST_MS = 500;

interface Surface {
  /** The window as drawn last; undefined before the first frame. */
  window(): TimeWindow | undefined;
  /** That of the memory strip. */
  strip(): TimeWindow | undefined;
  /** The span being selected, or undefined. */
  selecting(span: readonly [number, number] | undefined): void;
  /** A press at this height of the stack, px. */
  aim(y: number): void;
  /** Opens the frame of the sample there. */
  bytes(t: number): void;
}

type Grip = "a" | "b";

interface Press {
  readonly id: number;
  readonly x: number;
  readonly shift: boolean;
  readonly end: number;
  readonly strip: boolean;
  /** The cursor that the press took hold of. */
  readonly grip: Grip | undefined;
  moved: boolean;
}

/** Listen on the stack; the returned function stops. Canvases only: legends, names and buttons have their own handlers. */
export function listen(
  stack: HTMLElement,
  { view, cursor, measure, actions }: ViewState,
  surface: Surface,
): () => void {
  const fingers = new Map<number, number>();
  let resting: ReturnType<typeof setTimeout> | undefined;
  let press: Press | undefined;
  const stop = new AbortController();
  const on = <K extends keyof HTMLElementEventMap>(
    name: K,
    run: (event: HTMLElementEventMap[K]) => void,
    passive = true,
  ): void => stack.addEventListener(name, run, { signal: stop.signal, passive });
  const xIn = (event: MouseEvent): number => event.clientX - stack.getBoundingClientRect().left;
  const onCanvas = (event: Event): boolean => event.target instanceof HTMLCanvasElement;
  const inStrip = (event: Event): boolean =>
    event.target instanceof Element && event.target.parentElement?.className === "history-strip";
  const onAxis = (event: Event): boolean =>
    event.target instanceof Element && event.target.parentElement?.className === "axis";
  const inside = (w: TimeWindow, x: number): boolean => x >= w.left && x <= w.left + w.width;

  const hover = (x: number): void => {
    const w = surface.window();
    if (w === undefined || cursor.peek()?.kind === "pinned") return;
    cursor.value = inside(w, x) ? { kind: "pointer", fraction: (x - w.left) / w.width } : undefined;
  };
  /** The cursor at x, if a press there would take hold of it. */
  const gripAt = (x: number, reach: number): Grip | undefined => {
    const w = surface.window();
    if (w === undefined) return undefined;
    const at = { a: cursor.peek()?.kind === "pinned" ? actions.cursorTime() : undefined, b: measure.peek() };
    const away = ({ a, b } = at): readonly (readonly [Grip, number])[] =>
      (
        [
          ["b", b],
          ["a", a],
        ] as const
      ).flatMap(([name, t]) => (t === undefined ? [] : [[name, Math.abs(xOf(w, t) - x)] as const]));
    return away()
      .filter(([, distance]) => distance < reach)
      .sort(([, one], [, other]) => one - other)[0]?.[0];
  };
  const moveStrip = (x: number): void => {
    const strip = surface.strip();
    if (strip === undefined) return;
    if (x > strip.left + strip.width * (1 - LIVE_ZONE)) actions.live();
    else actions.centreAt(timeAt(strip, x));
  };
  const pinch = (event: PointerEvent): void => {
    const w = surface.window();
    const before = [...fingers.values()];
    fingers.set(event.pointerId, xIn(event));
    const after = [...fingers.values()];
    if (w === undefined || before.length !== 2) return;
    const spread = (xs: number[]): number => Math.max(24, Math.abs(xs[0]! - xs[1]!));
    const middle = (after[0]! + after[1]!) / 2;
    actions.zoom(spread(before) / spread(after), (middle - w.left) / w.width);
    const shift = middle - (before[0]! + before[1]!) / 2;
    if (!view.peek().live) actions.panTo(view.peek().end - (shift / w.width) * view.peek().span);
  };
  const drag = (event: PointerEvent, held: Press): void => {
    const w = surface.window();
    const x = xIn(event);
    if (w === undefined || (!held.moved && Math.abs(x - held.x) < CLICK_PX)) return;
    held.moved = true;
    clearTimeout(resting);
    stack.classList.add("dragging");
    if (held.strip) moveStrip(x);
    else if (held.grip !== undefined) {
      const t = timeAt(w, Math.min(w.left + w.width, Math.max(w.left, x)));
      if (held.grip === "a") actions.pin(t);
      else actions.pinMeasure(t);
    } else if (held.shift) surface.selecting([timeAt(w, held.x), timeAt(w, x)]);
    else actions.panTo(held.end - ((x - held.x) / w.width) * w.span);
  };
  /** With no cursor yet, the first is put there. */
  const measureHere = (): void => {
    const w = surface.window();
    if (w === undefined || press === undefined || press.moved || !inside(w, press.x)) return;
    const t = timeAt(w, press.x);
    press = undefined; // the finger is no longer a click
    if (cursor.peek()?.kind === "pinned") actions.pinMeasure(t);
    else actions.pin(t);
  };
  const click = (event: PointerEvent, held: Press): void => {
    const w = surface.window();
    if (held.strip) return moveStrip(held.x);
    if (w === undefined) return;
    const beside = onAxis(event) ? actions.cursorBeside() : undefined;
    const isThere = beside === "before" ? held.x < w.left + BESIDE_PX : held.x > w.left + w.width - BESIDE_PX;
    if (beside !== undefined && isThere) return actions.centreAt(actions.cursorTime() ?? actions.rightEdge());
    if (!inside(w, held.x)) return;
    const t = timeAt(w, held.x);
    if (held.shift) return actions.pinMeasure(t);
    const pinned = cursor.peek()?.kind === "pinned" ? actions.cursorTime() : undefined;
    if (pinned !== undefined && Math.abs(xOf(w, pinned) - held.x) < UNPIN_PX) {
      actions.unpin();
      if (event.pointerType === "mouse") hover(held.x);
    } else actions.pin(t);
  };

  on(
    "mousedown",
    (event) => {
      // A press on a plot leaves the focus ring away, and ends that of a button: Space must not press it again.
      if (!onCanvas(event)) return;
      event.preventDefault();
      if (document.activeElement instanceof HTMLButtonElement) document.activeElement.blur();
    },
    false,
  );
  on("pointerdown", (event) => {
    if (!onCanvas(event) || event.button !== 0) return;
    (event.target as Element).setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, xIn(event));
    clearTimeout(resting);
    surface.aim(event.clientY - stack.getBoundingClientRect().top + stack.scrollTop);
    if (event.pointerType === "touch" && fingers.size === 1 && !inStrip(event))
      resting = setTimeout(measureHere, REST_MS);
    // A second finger turns the press into a pinch.
    press =
      fingers.size > 1
        ? undefined
        : {
            id: event.pointerId,
            x: xIn(event),
            shift: event.shiftKey,
            end: actions.rightEdge(),
            strip: inStrip(event),
            grip:
              event.shiftKey || inStrip(event)
                ? undefined
                : gripAt(xIn(event), event.pointerType === "touch" ? FINGER_PX : GRIP_PX),
            moved: false,
          };
  });
  on("pointermove", (event) => {
    if (fingers.size > 1 && fingers.has(event.pointerId)) return pinch(event);
    if (press?.id === event.pointerId) drag(event, press);
    if (event.pointerType === "mouse" && onCanvas(event) && !inStrip(event)) {
      hover(xIn(event));
      const isGrip = (press?.grip ?? gripAt(xIn(event), GRIP_PX)) !== undefined;
      stack.classList.toggle("at-cursor", isGrip && !event.shiftKey);
    }
  });
  const end = (event: PointerEvent): void => {
    clearTimeout(resting);
    fingers.delete(event.pointerId);
    stack.classList.remove("dragging");
    const held = press;
    if (held?.id !== event.pointerId) return;
    press = undefined;
    const w = surface.window();
    surface.selecting(undefined);
    if (event.type === "pointercancel" || w === undefined) return;
    if (!held.moved) click(event, held);
    else if (held.shift && !held.strip) actions.select(timeAt(w, held.x), timeAt(w, xIn(event)));
  };
  on("pointerup", end);
  on("pointercancel", end);
  on("pointerleave", () => {
    if (cursor.peek()?.kind === "pointer") cursor.value = undefined;
  });
  on(
    "contextmenu",
    (event) => {
      const w = surface.window();
      const isTouch = event instanceof PointerEvent && event.pointerType === "touch"; // a finger that rests measures
      if (w === undefined || !onCanvas(event) || inStrip(event) || onAxis(event) || !inside(w, xIn(event))) return;
      event.preventDefault();
      if (isTouch) return;
      surface.aim(event.clientY - stack.getBoundingClientRect().top + stack.scrollTop);
      surface.bytes(timeAt(w, xIn(event)));
    },
    false,
  );
  on("dblclick", (event) => {
    if (!onCanvas(event) || inStrip(event)) return;
    actions.unpin(); // the first of the two clicks pinned
    actions.fit();
  });
  on(
    "wheel",
    (event) => {
      const w = surface.window();
      const x = xIn(event);
      // Over the gutter the wheel scrolls the stack; with Ctrl it is the browser's own zoom (or a pinch on a touchpad: ours).
      if (w === undefined || !onCanvas(event) || x < w.left) return;
      event.preventDefault();
      const unit =
        event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : event.deltaMode === WheelEvent.DOM_DELTA_PAGE ? 400 : 1;
      const sideways = event.shiftKey && event.deltaX === 0 ? event.deltaY : event.deltaX;
      if (Math.abs(sideways) > Math.abs(event.deltaY) || (event.shiftKey && sideways !== 0)) {
        actions.panTo(actions.rightEdge() + ((sideways * unit) / w.width) * view.peek().span);
      } else actions.zoom(Math.exp(event.deltaY * unit * WHEEL_STEP * (event.ctrlKey ? 4 : 1)), (x - w.left) / w.width);
    },
    false,
  );
  return () => stop.abort();
}
