/**
 * One plot: grid, scale, traces and the letters at their right end.
 *
 * It uses a canvas of its own instead of uPlot, because little of uPlot would be left. Its data model is one x array for all series of a
 * plot; ours are rings with a clock each, of different rates, which should not be joined or copied every frame. With all points in
 * view it takes 33 ms a frame for 18 series of 100 000 points, so extremes would have to be computed for it. Axes, legend, cursor,
 * zoom, gaps, hatch and wraps follow other rules on this page. What remains is moveTo and lineTo: trace.ts.
 *
 * A plot is drawn when something changed: the window moved by a pixel, samples came (ten times a second suffices while the window
 * stands still), a series was hidden, the theme or size changed.
 */
import type { Extent } from "../data/minmax-pyramid";
import type { Ring } from "../data/ring-buffer";
import { el } from "../ui/dom/dom";
import { number } from "../ui/format/format";
import { PixelColumns } from "./pixel-columns";
import type { TimeBase, Reads, PlotSpec, RightAxis, Series } from "../data/view";
import { Legend, type LegendActions, legendRows, namedByTitle, type Toggle, valueAt } from "./legend";
import { fitting, type Palette, setFont, CanvasLayer } from "./canvas-style";
import { traceDots, traceSeries } from "./trace";
import { ValueAxis } from "./value-axis";
import type { AxisState } from "./y-gutter";
import { timeGrid } from "./axis";
import { xOf, type TimeWindow } from "./time-window";
import { TEXT } from "../texts/plots";

const LEGEND_HEIGHT = 26;
/** Height of a row of the legend beside a plot, and of its title, px. */
const [ROW_PX, ROOM_PX] = [15.5, 26];
/** A plot is no lower, px: under that a curve is not read any more. */
const LEAST_PX = 104;
/** A longer title reaches the tick labels, px from the left. */
const TITLE_END_PX = 126;
const LINE_PX = 1.15;
/** Least distance of letters at the right end and of tick labels, px. */
const LETTERS_APART = 11.5;
const LABELS_APART = 12;
/** No tick label is centred above this, where the title reaches under the labels, px. */
const TITLE_PX = 25;
/** A tick label may be set this much narrower to fit the gutter: six digits of pressure on a phone. */
const CONDENSED_WIDTH = 0.68;
/** New samples alone redraw a window that stands still this often, ms. */
const STILL_MS = 100;
interface Shown {
  readonly series: Series;
  readonly columns: PixelColumns;
  /** Place of the series among `columns.columns`. */
  readonly at: number;
}

export class Plot {
  readonly root: HTMLElement;
  readonly legend: Legend;
  readonly sheet: CanvasLayer;
  /** Place in the stack, CSS px. */
  top = 0;
  visible = true;
  /** The title reaches under the tick labels, so the uppermost is omitted. */
  wideTitle = false;
  readonly left: ValueAxis;
  /** Of the second unit. */
  readonly right: ValueAxis | undefined;
  /** Least height with its legend in sight, px. */
  readonly least: number;
  readonly #rings: readonly Ring[];
  #shown: readonly Shown[] = [];
  #hidden: ReadonlySet<string> | undefined;
  readonly #extent: Extent = { lo: 0, hi: 0 };
  #stamp = "";
  #revision = -1;
  #drawnAt = -Infinity;
  #zoom = NaN;
  #legendHeight = LEGEND_HEIGHT;

  constructor(
    readonly spec: PlotSpec,
    toggle: Toggle,
    readonly state: AxisState,
    actions: LegendActions = {},
  ) {
    this.legend = new Legend(spec, toggle, actions);
    const unit = spec.unit === "" ? "" : TEXT.inUnit(spec.unit);
    const canvas = el("canvas", { role: "img", "aria-label": TEXT.plotOverTime(spec.title, unit) });
    this.left = new ValueAxis(spec, periodOf(spec.series.filter(({ isRight }) => !isRight)), state);
    this.right = spec.right && rightAxis(spec, spec.right, state);
    const gutters = [this.left.gutter, ...(this.right ? [this.right.gutter] : [])];
    this.root = el("div", { class: "plot", "data-key": spec.key }, this.legend.root, canvas, ...gutters);
    this.root.style.setProperty("--weight", String(spec.weight));
    this.least = Math.max(LEAST_PX, ROOM_PX + ROW_PX * legendRows(spec));
    this.root.style.setProperty("--least", `${this.least}px`);
    this.sheet = new CanvasLayer(canvas);
    this.#rings = [...new Set(spec.series.map(({ channel }) => channel.ring))];
  }

  /** Set the drawn series; hidden ones cost nothing. */
  #choose(hidden: ReadonlySet<string>): void {
    this.#hidden = hidden;
    this.#shown = this.#rings.flatMap((ring) => {
      const list = this.spec.series.filter(({ channel, key }) => channel.ring === ring && !hidden.has(key));
      const columns = new PixelColumns(
        ring,
        list.map(({ column }) => column),
      );
      return list.map((series, at) => ({ series, columns, at }));
    });
    this.#stamp = "";
  }

  /** Upper edge of the drawing: below a legend above it, px. */
  inset(look: Palette): number {
    return look.narrow ? this.#legendHeight : 0;
  }

  /** Makes room for a legend above the plot, which may have several rows; true if that changed. */
  makeRoom(look: Palette): boolean {
    const height = look.narrow ? Math.max(LEGEND_HEIGHT, this.legend.root.offsetHeight) : LEGEND_HEIGHT;
    if (height === this.#legendHeight) return false;
    this.#legendHeight = height;
    this.root.style.setProperty("--legend-h", `${height}px`);
    return true;
  }

  /** Note whether the title reaches the tick labels. */
  measureTitle(): void {
    const title = this.legend.root.querySelector("b");
    this.wideTitle = title !== null && title.offsetLeft + title.offsetWidth > TITLE_END_PX;
  }

  /** Position of a value, CSS px from the plot's top. @param isRight on the right axis */
  y(value: number, isRight = false): number {
    return (isRight && this.right ? this.right : this.left).y(value);
  }

  /** The visible series whose line is nearest to a height at a time; undefined without one. */
  seriesAt(y: number, t: number, base: TimeBase, hidden: ReadonlySet<string>, reads: Reads): Series | undefined {
    const [nearest] = this.spec.series
      .filter(({ key }) => !hidden.has(key))
      .map((series) => ({ series, away: Math.abs(this.y(valueAt(series, t, base, reads), series.isRight) - y) }))
      .filter(({ away }) => away >= 0) // not NaN
      .sort((a, b) => a.away - b.away);
    return nearest?.series;
  }

  /** Whether a height is within the drawing: a fixed range leaves values outside. */
  shows(y: number, look: Palette): boolean {
    return y >= this.inset(look) && y <= this.sheet.height;
  }

  /** Draw if anything changed. `now` in ms. */
  draw(w: TimeWindow, look: Palette, hidden: ReadonlySet<string>, now: number, theme: number): void {
    if (!this.visible || this.sheet.height < 10) return;
    if (hidden !== this.#hidden) this.#choose(hidden);
    for (const axis of this.#axes) if (axis.follow()) this.#stamp = "";
    const shown = this.#shown;
    const revision = this.#rings.reduce((sum, ring) => sum + ring.revision, 0);
    const stamp = `${w.g1} ${w.dt} ${w.base} ${theme}`;
    const still = stamp === this.#stamp;
    if (still && revision !== this.#revision && now - this.#drawnAt < STILL_MS) return;
    // a scale narrows with time alone, even if nothing else changes
    if (!this.#rescale(shown, w, now) && still && revision === this.#revision) return;
    [this.#stamp, this.#revision, this.#drawnAt] = [stamp, revision, now];
    this.#paint(shown, w, look);
  }

  get #axes(): readonly ValueAxis[] {
    return this.right ? [this.left, this.right] : [this.left];
  }

  /** Read the extent of the window; true if the scale changed. */
  #rescale(shown: readonly Shown[], w: TimeWindow, now: number): boolean {
    const zoomed = w.dt !== this.#zoom;
    this.#zoom = w.dt;
    let changed = false;
    for (const axis of this.#axes) {
      let lo = Infinity;
      let hi = -Infinity;
      for (const { series, columns } of shown) {
        if ((series.isRight === true) !== (axis === this.right)) continue;
        const { ring } = columns;
        ring.pyramids[series.column]!.query(ring.row(w.t0, w.base), ring.row(w.t1, w.base), this.#extent);
        if (this.#extent.lo < lo) lo = this.#extent.lo;
        if (this.#extent.hi > hi) hi = this.#extent.hi;
      }
      if (axis.rescale(lo, hi, now, zoomed)) changed = true;
    }
    return changed;
  }

  #paint(shown: readonly Shown[], w: TimeWindow, look: Palette): void {
    const { sheet } = this;
    const x = sheet.begin();
    const top = this.inset(look) + 6;
    for (const axis of this.#axes) axis.place(top, sheet.height - top - 5);
    const isWide = this.#isWide(x, look);
    this.#grid(x, w, look, isWide);
    x.save();
    x.beginPath();
    x.rect(w.left, this.inset(look), w.width, sheet.height);
    x.clip();
    x.lineWidth = LINE_PX;
    x.lineJoin = "bevel";
    x.lineCap = "round";
    for (const columns of new Set(shown.map((one) => one.columns))) columns.prepare(w.g0, w.g1, w.dt, w.base);
    for (let i = shown.length - 1; i >= 0; i--) {
      const { series, columns, at } = shown[i]!;
      x.strokeStyle = x.fillStyle = look.colour[series.colour];
      x.setLineDash(series.dash as number[]);
      const { vertical } = series.isRight && this.right ? this.right : this.left;
      traceSeries(x, columns, at, w, vertical);
      traceDots(x, columns, at, w, vertical);
    }
    x.restore();
    if (!namedByTitle(this.spec)) this.#letters(x, shown, w, look);
    if (isWide) this.#labelsInside(x, this.left, w, look);
    if (this.right) this.#labelsInside(x, this.right, w, look);
    for (const axis of this.#axes) this.#outside(x, w, look, axis);
  }

  #grid(x: CanvasRenderingContext2D, w: TimeWindow, look: Palette, isWide: boolean): void {
    const { sheet } = this;
    const hair = 1 / sheet.ratio;
    const inset = this.inset(look);
    x.fillStyle = look.colour.grid;
    for (const t of timeGrid(w)) x.fillRect(sheet.snap(xOf(w, t)), inset, 1, sheet.height);
    setFont(x, look, look.small);
    x.textAlign = "right";
    x.textBaseline = "middle";
    const room = roomFor(look);
    for (const { value } of this.left.labels(sheet.height - inset)) {
      x.fillStyle = look.colour[value === 0 ? "grid-zero" : "grid"];
      x.fillRect(w.left, sheet.snap(this.y(value)), w.width, Math.max(hair, 1));
    }
    x.fillStyle = look.colour["ink-3"];
    const top = inset + (this.wideTitle && !look.narrow ? TITLE_PX : 5);
    for (const { text, y } of isWide ? [] : this.#labels(this.left, inset, top))
      if (x.measureText(text).width * CONDENSED_WIDTH <= room) x.fillText(text, look.gutter - 7, y, room);
    x.fillStyle = look.colour.line;
    x.fillRect(sheet.snap(w.left) - 1, inset, 1, sheet.height);
    x.fillRect(sheet.snap(w.left + w.width), inset, 1, sheet.height);
  }

  /** Whether the labels of the left axis have too many digits for the gutter: of a clock or a latitude. */
  #isWide(x: CanvasRenderingContext2D, look: Palette): boolean {
    setFont(x, look, look.small);
    const labels = this.left.labels(this.sheet.height - this.inset(look));
    return labels.length > 0 && labels.every(({ text }) => x.measureText(text).width * CONDENSED_WIDTH > roomFor(look));
  }

  /** Labels of an axis over the traces, and the unit of the right one. */
  #labelsInside(x: CanvasRenderingContext2D, axis: ValueAxis, w: TimeWindow, look: Palette): void {
    const inset = this.inset(look);
    const isRight = axis === this.right;
    const edge = isRight ? w.left + w.width : w.left;
    setFont(x, look, look.small);
    x.textAlign = isRight ? "right" : "left";
    x.textBaseline = "middle";
    const write = (text: string, y: number): void => {
      const width = x.measureText(text).width;
      x.globalAlpha = 0.8;
      x.fillStyle = look.colour.bg;
      x.fillRect(isRight ? edge - width - 10 : edge + 6, y - 6, width + 4, 12);
      x.globalAlpha = 1;
      x.fillStyle = look.colour["ink-2"];
      x.fillText(text, isRight ? edge - 8 : edge + 8, y);
      x.fillRect(isRight ? edge - 4 : edge, this.sheet.snap(y), 4, 1);
    };
    const hasUnit = isRight && axis.spec.unit !== "";
    if (hasUnit) write(axis.spec.unit, inset + 8);
    for (const { text, y } of this.#labels(axis, inset, inset + (hasUnit ? 8 + LABELS_APART : 5))) write(text, y);
  }

  /** Labels of an axis with room for each, below `top`. */
  #labels(axis: ValueAxis, inset: number, top: number): readonly { readonly text: string; readonly y: number }[] {
    const kept: { readonly text: string; readonly y: number }[] = [];
    for (const { text, value } of axis.labels(this.sheet.height - inset)) {
      const y = this.sheet.snap(axis.y(value));
      const hasRoom = y >= top && y <= this.sheet.height - 5;
      if (hasRoom && kept.every((one) => Math.abs(one.y - y) >= LABELS_APART)) kept.push({ text, y });
    }
    return kept;
  }

  /** Values outside of a fixed range: the furthest in the window, at the edge beyond which it is. */
  #outside(x: CanvasRenderingContext2D, w: TimeWindow, look: Palette, axis: ValueAxis): void {
    if (axis.range === undefined) return;
    const [low, high] = axis.range;
    const { decimals } = axis.spec;
    const shown = [
      { isThere: axis.highest > high, text: `▲ ${number(axis.highest, decimals)}`, y: this.inset(look) + 8 },
      { isThere: axis.lowest < low, text: `▼ ${number(axis.lowest, decimals)}`, y: this.sheet.height - 8 },
    ];
    setFont(x, look, 10.5, 650);
    x.textAlign = "right";
    x.textBaseline = "middle";
    for (const { isThere, text, y } of shown) {
      if (!isThere) continue;
      const width = x.measureText(text).width + 8;
      const isLeft = this.right !== undefined && axis === this.left;
      const right = isLeft ? w.left + 2 + width : w.left + w.width - 2;
      x.fillStyle = look.colour["status-warn"];
      x.fillRect(right - width, y - 7, width, 14);
      x.fillStyle = look.colour["status-warn-ink"];
      x.fillText(text, right - 4, y + 0.5);
    }
  }

  /** Label each trace at its end with a letter, not by colour alone; letters are moved apart. */
  #letters(x: CanvasRenderingContext2D, shown: readonly Shown[], w: TimeWindow, look: Palette): void {
    const letters = shown
      .map(({ series }) => ({ series, y: this.y(lastIn(series, w), series.isRight) }))
      .filter(({ y }) => y === y)
      .sort((a, b) => a.y - b.y);
    for (let round = 0; round < 6; round++) {
      for (let i = 1; i < letters.length; i++) {
        const [a, b] = [letters[i - 1]!, letters[i]!];
        const over = LETTERS_APART - (b.y - a.y);
        if (over > 0) [a.y, b.y] = [a.y - over / 2, b.y + over / 2];
      }
    }
    // what ends beyond a fixed range has its letter at the edge
    let edge = this.sheet.height - 7;
    for (const letter of letters.toReversed()) edge = (letter.y = Math.min(letter.y, edge)) - LETTERS_APART;
    edge = this.inset(look) + 6;
    for (const letter of letters) edge = (letter.y = Math.max(letter.y, edge)) + LETTERS_APART;
    x.textAlign = "left";
    x.textBaseline = "middle";
    setFont(x, look, 11, 650);
    for (const { series, y } of letters) {
      x.fillStyle = look.colour[series.colour];
      const { label, mark = look.narrow ? label.charAt(0) : "" } = series;
      const isWhole = label !== "" && (look.narrow ? label.length <= 3 : x.measureText(label).width <= look.tail - 5);
      x.fillText(isWhole ? label : mark || fitting(x, label, look.tail - 5), w.left + w.width + 4, y);
    }
  }
}

/** Room for tick labels in the gutter, px. */
const roomFor = ({ narrow, gutter }: Palette): number => (narrow ? gutter - 8 : gutter - 125);

/** Value at which all of them wrap; 0: not all do. */
function periodOf(series: readonly Series[]): number {
  const periods = series.map(({ channel, column }) => channel.info.columns[column]!.period);
  return periods.length === 0 ? 0 : Math.min(...periods);
}

function rightAxis(spec: PlotSpec, { key, unit, decimals }: RightAxis, state: AxisState): ValueAxis {
  const axis = new ValueAxis(
    { key, unit, decimals, title: TEXT.rightOf(spec.title) },
    periodOf(spec.series.filter(({ isRight }) => isRight)),
    state,
  );
  axis.gutter.classList.add("right");
  return axis;
}

/** The newest value in the window. */
function lastIn(series: Series, w: TimeWindow): number {
  const { ring } = series.channel;
  const row = ring.row(w.t1, w.base) - 1;
  if (row < ring.first) return NaN;
  return valueAt(series, (w.base === "device" ? ring.times : ring.arrivals)[row & ring.mask]!, w.base);
}
