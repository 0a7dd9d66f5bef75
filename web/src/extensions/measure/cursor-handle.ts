/** Cursor A or B as a slider in the measuring table: its time, moved by the arrow keys. */
import type { ViewState } from "../../data/view-state";
import { el, LiveText } from "../../ui/dom/dom";
import { clock } from "../../ui/format/format";
import { TEXT } from "./texts";

/** An arrow key moves by this part of the window. */
const STEP = 1 / 200;

export class CursorHandle {
  readonly node: HTMLElement;
  readonly #time = new LiveText();

  constructor(
    readonly viewState: ViewState,
    readonly which: "a" | "b",
  ) {
    this.node = el(
      "span",
      {
        class: `cursor-handle ${which}`,
        role: "slider",
        tabindex: "0",
        "aria-label": TEXT.cursorLabel[which],
        title: TEXT.cursorHint,
      },
      el("i", {}, TEXT.cursor[which]),
      this.#time.node,
    );
    this.node.addEventListener("keydown", (event) => this.#press(event));
  }

  get time(): number | undefined {
    return this.which === "a" ? this.viewState.actions.cursorTime() : this.viewState.measure.peek();
  }

  /** "A 14:32:18.123456 UTC". */
  words(): string {
    return `${TEXT.cursor[this.which]} ${TEXT.utc(clock(this.time ?? NaN, 6))}`;
  }

  update(): void {
    const { time } = this;
    if (time === undefined) return;
    const { span } = this.viewState.view.peek();
    const end = this.viewState.actions.rightEdge();
    const text = clock(time, 3);
    this.#time.set(text);
    const set = (name: string, value: string): void => {
      if (this.node.getAttribute(name) !== value) this.node.setAttribute(name, value);
    };
    set("aria-valuetext", TEXT.utc(text));
    set("aria-valuemin", String(Math.min(time, end - span)));
    set("aria-valuemax", String(Math.max(time, end)));
    set("aria-valuenow", String(time));
  }

  #press(event: KeyboardEvent): void {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const direction = event.key === "ArrowLeft" ? -1 : event.key === "ArrowRight" ? 1 : 0;
    const { time } = this;
    if (direction === 0 || time === undefined) return;
    event.preventDefault();
    event.stopPropagation(); // the arrows also move the window
    const { actions, view } = this.viewState;
    if (this.which === "a") {
      if (event.shiftKey) actions.stepSample(direction);
      else actions.pin(time + direction * STEP * view.peek().span);
    } else if (event.shiftKey) actions.stepMeasure(direction);
    else actions.pinMeasure(time + direction * STEP * view.peek().span);
  }
}
