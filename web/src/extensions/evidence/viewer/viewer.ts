/** The viewer in the file: plots with one time axis, two cursors, and what is measured between them. */
import { duration } from "../../../plots/axis";
import { el } from "../../../ui/dom/dom";
import { clock, number } from "../../../ui/format/format";
import { TEXT } from "./texts";
import type { Content, EmbeddedPlot } from "./content";
import { draw, LEFT, RIGHT, type Marks, type DrawnRange } from "./drawing";
import { difference, measured, nearestRow, valuesAt, readingText, stepped } from "./reading";

type CursorName = "a" | "b";
const LEAST_SPAN_S = 1e-5;
const PLOT_PX = 168;
/** Size on paper, px: texts are as large as on the screen. */
const PAPER = { width: 720, height: 150, ratio: 3 };

interface Drawn {
  readonly plot: EmbeddedPlot;
  readonly canvas: HTMLCanvasElement;
  readonly values: readonly HTMLElement[];
}

export class EvidenceViewer {
  shown: DrawnRange;
  /** The cursor that a plain click sets. */
  sets: CursorName = "a";
  readonly #span: number;
  readonly #marks: Marks;
  readonly #drawn: readonly Drawn[];
  readonly #chips = { a: el("span", { class: "chip" }), b: el("span", { class: "chip" }), apart: el("span", {}) };
  readonly #table = el("div", { class: "wide" });
  readonly #setters: readonly HTMLButtonElement[];
  #waits = false;
  #isPaper = false;

  constructor(content: Content, plots: readonly EmbeddedPlot[], host: HTMLElement) {
    const { t0, t1, cursors, events, notes } = content;
    this.#span = t1 - t0;
    const at = (t: number | null): number | undefined => (t === null ? undefined : t - t0);
    this.shown = { from: 0, to: this.#span, a: at(cursors.a), b: at(cursors.b) };
    this.#marks = {
      t0,
      losses: events.flatMap((one) =>
        one.kind === "gap" && one.t0 !== null && one.t1 !== null ? [[one.t0 - t0, one.t1 - t0] as const] : [],
      ),
      notes: notes.times.map(({ time }) => time - t0),
    };
    this.#setters = (["a", "b"] as const).map((name) =>
      this.#button(TEXT.cursor[name], () => {
        this.sets = name;
        this.#redraw();
      }),
    );
    this.#drawn = plots.map((plot) => this.#build(plot));
    host.replaceChildren(
      this.#toolbar(),
      ...this.#drawn.map(({ canvas }) => canvas.parentElement ?? canvas),
      this.#table,
    );
    this.#drawn.forEach(({ canvas }, k) => listenTo(canvas, this, k));
    new ResizeObserver(() => this.#redraw()).observe(host);
    this.#redraw();
  }

  // ── what is shown ──────────────────────────────────────────────────────────────────────────────────────────────

  timeAt(fraction: number): number {
    const { from, to } = this.shown;
    return from + Math.min(Math.max(fraction, 0), 1) * (to - from);
  }

  /** Show a window moved by a part of its length, within the range. */
  show(from: number, to: number, by = 0): void {
    const span = Math.min(Math.max(to - from, LEAST_SPAN_S), this.#span);
    const begin = Math.min(Math.max(from + by * span, 0), this.#span - span);
    this.shown = { ...this.shown, from: begin, to: begin + span };
    this.#redraw();
  }

  pan(windows: number): void {
    this.show(this.shown.from, this.shown.to, windows);
  }

  zoom(factor: number, fraction = 0.5): void {
    const { from, to } = this.shown;
    const span = Math.min(Math.max((to - from) * factor, LEAST_SPAN_S), this.#span);
    const begin = this.timeAt(fraction) - Math.min(Math.max(fraction, 0), 1) * span;
    this.show(begin, begin + span);
  }

  whole(): void {
    this.show(0, this.#span);
  }

  /** Show a moment, and put A there; or a range between A and B. */
  goTo(unix: number, end?: number): void {
    const t = unix - this.#marks.t0;
    if (end !== undefined) {
      const to = end - this.#marks.t0;
      const room = (to - t) / 4;
      this.show(t - room, to + room);
      this.setCursor("b", to);
      return this.setCursor("a", t);
    }
    const half = (this.shown.to - this.shown.from) / 2;
    if (t < this.shown.from || t > this.shown.to) this.show(t - half, t + half);
    this.setCursor("a", t);
  }

  // ── cursors ────────────────────────────────────────────────────────────────────────────────────────────────────

  /** The cursor within `near` of a place, both as parts of the width. */
  cursorNear(fraction: number, near: number): CursorName | undefined {
    const { from, to } = this.shown;
    const far = (t: number | undefined): number =>
      t === undefined ? Infinity : Math.abs((t - from) / (to - from) - fraction);
    const [a, b] = [far(this.shown.a), far(this.shown.b)];
    return Math.min(a, b) > near ? undefined : b < a ? "b" : "a";
  }

  /** Put a cursor on the nearest sample of a plot. */
  setCursor(name: CursorName, t: number, plot = 0): void {
    const curve = this.#drawn[plot]?.plot.curves[0];
    const row = curve && nearestRow(curve, t);
    this.shown = { ...this.shown, [name]: row === undefined ? t : (curve?.times[row] ?? t) };
    this.#redraw();
  }

  stepCursor(name: CursorName, by: number): void {
    const curve = this.#drawn[0]?.plot.curves[0];
    const t = this.shown[name];
    if (curve && t !== undefined) this.setCursor(name, stepped(curve, t, by));
  }

  clear(): void {
    this.shown = { ...this.shown, a: undefined, b: undefined };
    this.sets = "a";
    this.#redraw();
  }

  // ── drawing ────────────────────────────────────────────────────────────────────────────────────────────────────

  /** Draw for paper, or for the screen again. */
  paper(isPaper: boolean): void {
    this.#isPaper = isPaper;
    this.#draw();
  }

  /** Draw with other colours. */
  repaint(): void {
    this.#redraw();
  }

  #redraw(): void {
    if (this.#waits) return;
    this.#waits = true;
    requestAnimationFrame(() => {
      this.#waits = false;
      this.#draw();
    });
  }

  #draw(): void {
    const style = getComputedStyle(document.documentElement);
    const colour = (name: string): string => style.getPropertyValue(name).trim();
    for (const { plot, canvas } of this.#drawn) {
      const size = this.#isPaper
        ? PAPER
        : { width: canvas.clientWidth, height: PLOT_PX, ratio: globalThis.devicePixelRatio || 1 };
      const x = canvas.getContext("2d");
      if (x === null || size.width < 100) continue;
      canvas.width = Math.round(size.width * size.ratio);
      canvas.height = Math.round(size.height * size.ratio);
      x.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
      draw(x, size.width, size.height, plot, this.shown, this.#marks, colour);
      const { t0 } = this.#marks;
      const ends = [clock(t0 + this.shown.from, 3), clock(t0 + this.shown.to, 3)] as const;
      canvas.setAttribute("aria-label", TEXT.canvas(plot.title, plot.unit, ...ends));
    }
    this.#say();
  }

  #say(): void {
    const { a, b } = this.shown;
    const { t0 } = this.#marks;
    for (const [name, t] of [["a", a] as const, ["b", b] as const]) {
      this.#chips[name].hidden = t === undefined;
      this.#chips[name].textContent = t === undefined ? "" : TEXT.at(TEXT.cursor[name], clock(t0 + t, 4));
    }
    this.#chips.apart.textContent =
      a === undefined || b === undefined ? "" : TEXT.apart(duration(b - a), `${number(1 / Math.abs(b - a), 4)} Hz`);
    this.#setters.forEach((button, k) =>
      button.setAttribute("aria-pressed", String(this.sets === (k === 0 ? "a" : "b"))),
    );
    const t = a ?? b;
    for (const { plot, values } of this.#drawn) {
      plot.curves.forEach((curve, k) => {
        const node = values[k];
        if (node) node.textContent = t === undefined ? "" : readingText(curve, valuesAt(curve, t));
      });
    }
    this.#measure();
  }

  #measure(): void {
    const { a, b } = this.shown;
    if (a === undefined || b === undefined) return this.#table.replaceChildren();
    const rows = this.#drawn.flatMap(({ plot }) =>
      plot.curves.map((curve) => {
        const { min, max, mean, n } = measured(curve, a, b);
        const value = (v: number | undefined): string => `${number(v, curve.decimals)} ${plot.unit}`.trim();
        const at = (t: number): string => `${readingText(curve, valuesAt(curve, t))} ${plot.unit}`.trim();
        const cells = [at(a), at(b), value(difference(curve, a, b)), value(min), value(max), value(mean)];
        return el(
          "tr",
          {},
          el("th", { scope: "row" }, `${plot.title}: ${curve.label}`),
          ...[...cells, number(curve.isExact ? n : undefined, 0)].map((cell) => el("td", {}, cell)),
        );
      }),
    );
    const isThinned = this.#drawn.some(({ plot }) => plot.curves.some(({ isExact }) => !isExact));
    this.#table.replaceChildren(
      el(
        "table",
        { class: "numbers measured" },
        el("caption", {}, TEXT.measured, " ", el("small", {}, isThinned ? TEXT.measuredThinned : TEXT.measuredHint)),
        el("thead", {}, el("tr", {}, ...TEXT.heads.map((head) => el("th", { scope: "col" }, head)))),
        el("tbody", {}, ...rows),
      ),
    );
  }

  // ── elements ───────────────────────────────────────────────────────────────────────────────────────────────────

  #button(label: string, act: () => void, name = label): HTMLButtonElement {
    const button = el("button", { type: "button", "aria-label": name, title: name }, label);
    button.addEventListener("click", act);
    return button;
  }

  #toolbar(): HTMLElement {
    const toCursors = (): void => {
      const { a, b } = this.shown;
      if (a !== undefined && b !== undefined) this.show(Math.min(a, b), Math.max(a, b));
    };
    return el(
      "div",
      { class: "toolbar", role: "group", "aria-label": TEXT.plots },
      this.#button("−", () => this.zoom(2), TEXT.zoomOut),
      this.#button("+", () => this.zoom(0.5), TEXT.zoomIn),
      this.#button(TEXT.whole, () => this.whole()),
      this.#button(TEXT.toCursors, toCursors),
      el(
        "span",
        { class: "sets", role: "group", "aria-label": TEXT.sets },
        el("small", {}, TEXT.sets),
        ...this.#setters,
      ),
      this.#button("×", () => this.clear(), TEXT.clear),
      el("output", {}, this.#chips.a, this.#chips.b, this.#chips.apart),
      el("p", { class: "hint" }, TEXT.hint),
    );
  }

  #build(plot: EmbeddedPlot): Drawn {
    const canvas = el("canvas", { role: "img" });
    const values = plot.curves.map(() => el("span", { class: "value" }));
    const legend = plot.curves.map((curve, k) => {
      const swatch = el("i", {});
      swatch.style.borderTop = `2px ${curve.dash.length > 0 ? "dashed" : "solid"} var(--${curve.colour})`;
      return el("span", { class: "curve" }, swatch, curve.label, " ", values[k] ?? "");
    });
    const title = el("b", {}, plot.title);
    el("figure", { class: "plot" }, el("figcaption", {}, title, el("small", {}, plot.unit), ...legend), canvas);
    return { plot, canvas, values };
  }
}

const SLACK_PX = 5;
const NEAR_PX = 9;
const ZOOM_PER_PX = 1.0015; // of zoom for each pixel of the wheel

/** Wheel, dragging and pinching over a plot: zoom and move; a click or a dragged handle sets a cursor. */
function listenTo(canvas: HTMLCanvasElement, viewer: EvidenceViewer, plot: number): void {
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
      else viewer.zoom(ZOOM_PER_PX ** event.deltaY, fraction(event.clientX));
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
