/**
 * The measuring table: the time between cursors A and B, and figures of every visible series at both and between them. Values
 * follow ten times a second; figures over the range are computed a little in every frame, once for each range, and are dimmed until
 * they are those of the range shown.
 */
import { rangeFigures, NO_FIGURES, type RangeFigures } from "./range-figures";
import type { ViewState } from "../../data/view-state";
import { figure } from "../../charts/axes";
import { duration } from "../../plots/axis";
import { differenceOf, valueAt } from "../../plots/legend";
import { labelOf } from "../../signals/plot-selection";
import type { PlotSpec, Series } from "../../data/view";
import { byUnit, visible } from "../../plots/visible-plots";
import { copyText } from "../../ui/dom/copy";
import { el, LiveText, type Panel, throttle, unit } from "../../ui/dom/dom";
import { NONE, clock } from "../../ui/format/format";
import {
  measuredCsv,
  FIGURE_KEYS,
  type FigureKey,
  type Figures,
  figureText,
  type MeasuredRow,
  measuredText,
  figureUnit,
} from "./figure-columns";
import type { SampleAccess } from "../../measure/sample-access";
import type { MeasuredRange } from "../../measure/figure-source";
import { ServerFigures } from "./server-figures";
import { COMMON } from "../../texts/common";
import { TEXT } from "./texts";
import "./measure.css";

/** By default the rings of the channels hold all samples. */
export interface MeasureDeps extends Partial<SampleAccess> {
  readonly viewState: ViewState;
}

/** Time for figures in one frame's 16 ms, in ms; one series is done in any case. */
const FIGURES_MS = 3;

/** For a line whose figures are not known yet or belong to another range. */
const UNKNOWN: RangeFigures = { ...NO_FIGURES, n: NaN, gaps: NaN };

interface Line {
  readonly series: Series;
  readonly unit: string;
  readonly tr: HTMLElement;
  readonly cells: Readonly<Record<FigureKey, LiveText>>;
  values: Pick<Figures, "a" | "b" | "delta">;
  /** Over the range that `stamp` names. */
  figures: RangeFigures;
  stamp: string;
}

export function mountMeasure(host: HTMLElement, deps: MeasureDeps): Panel {
  const { viewState, reads, source } = deps;
  const { actions, view } = viewState;
  const server = source && new ServerFigures(source);
  const [delta, frequency] = [new LiveText(), new LiveText()];
  const handles = [new CursorHandle(viewState, "a"), new CursorHandle(viewState, "b")];
  const said = el("span", { role: "status", class: "dim" });
  const problem = el("span", { role: "status", class: "measure-problem" });
  const snap = el("button", { type: "button", class: "btn toggle" }, TEXT.snap);
  const showSnap = (): void => snap.setAttribute("aria-pressed", String(viewState.snap.peek()));
  showSnap();
  snap.addEventListener("click", () => {
    actions.setSnap(!viewState.snap.peek());
    showSnap();
  });
  const copy = (text: string, of: () => string): HTMLElement => {
    const button = el("button", { type: "button", class: "btn edge" }, text);
    button.addEventListener("click", () => {
      void copyText(of()).then((done) => (said.textContent = done ? COMMON.copied : COMMON.notCopied));
    });
    return button;
  };
  const bytes = el("button", { type: "button", class: "btn edge", title: TEXT.bytesHereHint }, TEXT.bytesHere);
  bytes.addEventListener("click", () => actions.bytes());
  const close = el(
    "button",
    { type: "button", class: "btn icon measure-close", "aria-label": TEXT.close, title: TEXT.close },
    "✕",
  );
  close.addEventListener("click", () => (viewState.measure.value = undefined));
  const head = el(
    "div",
    { class: "measure-head" },
    ...handles.map(({ node }) => node),
    el("span", { class: "measure-time" }, el("span", { class: "dim" }, `${TEXT.time} `), el("b", {}, delta.node)),
    el(
      "span",
      { class: "measure-time" },
      el("span", { class: "dim" }, `${TEXT.frequency} `),
      el("b", {}, frequency.node),
    ),
    problem,
    el("span", { class: "grow" }),
    said,
    snap,
    bytes,
    copy(TEXT.copyText, () => measuredText(heading(), rows())),
    copy(TEXT.copyCsv, () => measuredCsv(actions.cursorTime() ?? NaN, viewState.measure.peek() ?? NaN, rows())),
    close,
  );
  const columns = el("tr", {}, el("th", { scope: "col" }, el("span", { class: "visually-hidden" }, TEXT.signal)));
  for (const key of FIGURE_KEYS) {
    const about = key === "gaps" ? { "data-about": "time" } : {}; // an extension makes a link of it
    const name = el("span", about, TEXT.heads[key]);
    columns.append(el("th", { scope: "col", class: "num", title: TEXT.hints[key] }, name));
  }
  const body = el("tbody");
  const table = el(
    "table",
    {},
    el("caption", { class: "visually-hidden" }, TEXT.title),
    el("thead", {}, columns),
    body,
  );
  const scroll = el("div", { class: "measure-table", tabindex: "0", role: "group", "aria-label": TEXT.title }, table);
  host.append(head, scroll);

  let shown = "";
  let lines: readonly Line[] = [];
  let turn = 0;
  const due = throttle(10);

  const heading = (): string[] => [
    ...handles.map((handle) => handle.words()),
    `${TEXT.time} ${delta.node.data}   ${TEXT.frequency} ${frequency.node.data}`,
  ];
  /** The lines as of now, whatever of them is drawn yet. */
  const rows = (): MeasuredRow[] => {
    const range = rangeOf();
    return lines.map((line) => {
      if (range !== undefined) read(line, range.a, range.b);
      const figures = range !== undefined && count(line, range) ? line.figures : UNKNOWN;
      const { series, unit: own, values } = line;
      return { signal: series.key, unit: own, decimals: series.decimals, figures: { ...values, ...figures } };
    });
  };

  /** The cursors, and the range between them; undefined unless both are set. */
  const rangeOf = (): (MeasuredRange & { readonly a: number; readonly b: number }) | undefined => {
    const [a, b] = [actions.cursorTime(), viewState.measure.peek()];
    if (a === undefined || b === undefined) return undefined;
    return { a, b, t0: Math.min(a, b), t1: Math.max(a, b), base: view.peek().timeBase };
  };

  const read = (line: Line, a: number, b: number): void => {
    const { timeBase: base } = view.peek();
    const { series } = line;
    line.values = {
      a: valueAt(series, a, base, reads),
      b: valueAt(series, b, base, reads),
      delta: differenceOf(series, a, b, base, reads),
    };
    for (const key of ["a", "b", "delta"] as const)
      line.cells[key].set(figureText(key, line.values[key], series.decimals));
  };

  /** Compute figures of a line, or take them from the server; false while they are those of another range. */
  const count = (line: Line, range: MeasuredRange): boolean => {
    const { series } = line;
    const { t0, t1, base } = range;
    const ring = deps.ringOf === undefined ? series.channel.ring : deps.ringOf(series.channel, t0, t1);
    const place = ring ? `${ring.generation} ${ring.row(t0, base)} ${ring.row(t1, base, true)}` : "server";
    const stamp = `${t0} ${t1} ${base} ${place}`;
    if (stamp === line.stamp) return true;
    const period = series.channel.info.columns[series.column]?.period ?? 0;
    const found = ring ? rangeFigures(ring, series.column, t0, t1, base, period) : server?.of(series, range);
    if (found === undefined) return false;
    line.figures = found;
    line.stamp = stamp;
    for (const key of Object.keys(NO_FIGURES) as (keyof RangeFigures)[])
      line.cells[key].set(figureText(key, found[key], series.decimals));
    return true;
  };

  return {
    update(now) {
      const found = rangeOf();
      if (found === undefined) return;
      const { a, b, ...range } = found;
      if (due(now)) {
        const specs = visible(actions.plots(), viewState.hiddenSeries.peek());
        const key = keyOf(specs);
        if (key !== shown) [shown, lines, turn] = [key, build(body, specs), 0];
        for (const handle of handles) handle.update();
        delta.set(duration(b - a));
        frequency.set(a === b ? NONE : `${figure(1 / Math.abs(b - a), 5)} Hz`);
        for (const line of lines) read(line, a, b);
        server?.want(
          lines
            .map(({ series }) => series)
            .filter(({ channel }) => deps.ringOf?.(channel, range.t0, range.t1) === undefined),
          range,
          now,
        );
        const failed = server?.problem?.message ?? "";
        if (problem.textContent !== failed) problem.textContent = failed;
      }
      const until = performance.now() + FIGURES_MS;
      for (let k = 0; k < lines.length && (k === 0 || performance.now() < until); k++) {
        const line = lines[turn++ % lines.length];
        line?.tr.classList.toggle("pending", !count(line, range));
      }
    },
    dispose() {
      server?.dispose();
      host.replaceChildren();
    },
  };
}

const keyOf = (plots: readonly PlotSpec[]): string =>
  plots
    .map(
      ({ key, frame, series }) =>
        `${key} ${frame} ${series.map((one) => `${one.key} ${one.channel.info.id}`).join(" ")}`,
    )
    .join("\n");

function build(body: HTMLTableSectionElement, plots: readonly PlotSpec[]): Line[] {
  body.replaceChildren();
  return plots.flatMap(byUnit).flatMap((plot) => {
    const title = el("th", { scope: "rowgroup" }, plot.title);
    const group = el("tr", { class: "group-row" }, title);
    for (const key of FIGURE_KEYS) group.append(el("td", { class: "num" }, unit(figureUnit(key, plot.unit))));
    body.append(group);
    return plot.series.map((series) => lineOf(body, plot, series));
  });
}

function lineOf(body: HTMLTableSectionElement, plot: PlotSpec, series: Series): Line {
  const info = series.channel.info.columns[series.column];
  const own = info?.unit || plot.unit;
  const tr = el("tr", { class: "pending" }, el("th", { scope: "row", class: series.colour }, labelOf(series)));
  const cells = Object.fromEntries(FIGURE_KEYS.map((key) => [key, new LiveText()])) as Record<FigureKey, LiveText>;
  for (const key of FIGURE_KEYS) {
    const text = figureUnit(key, own);
    const cell = el("td", { class: "num", "data-head": TEXT.heads[key] }, cells[key].node);
    if (text !== "") cell.append(unit(text));
    tr.append(cell);
  }
  body.append(tr);
  const none = { a: NaN, b: NaN, delta: NaN };
  return { series, unit: own, tr, cells, values: none, figures: UNKNOWN, stamp: "" };
}

/** An arrow key moves by this part of the window. */
const STEP = 1 / 200;

class CursorHandle {
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
