/**
 * A y axis of a plot: the scale that follows the data, or what a person chose instead, and the control over its labels. A plot has one on
 * its left; signals of a second unit have one of their own on its right.
 */
import type { YAxis } from "../data/view";
import { number } from "../ui/format/format";
import { Scale, ticks } from "../charts/scale";
import { type Vertical, yOf } from "./trace";
import { isLogarithmic, logTicks } from "./y-axis";
import { type AxisState, type DrawnAxis, type GutterSpec, showAxis, yGutter } from "./y-gutter";

/** The narrowest logarithmic axis that follows the data, decades. */
const LEAST_DECADES = 0.05;
const STANDARD_GRAVITY = 9.80665;

export interface AxisSpec extends GutterSpec {
  readonly decimals: number;
}

export class ValueAxis {
  readonly gutter: HTMLButtonElement;
  /** Extent of the data in the window. */
  lowest = NaN;
  highest = NaN;
  vertical: Vertical = { top: 0, hi: 1, k: 1 };
  readonly spec: AxisSpec;
  readonly #state: AxisState;
  readonly #scale: Scale;
  /** Scale of the powers of ten, on a logarithmic axis. */
  readonly #decades = new Scale(LEAST_DECADES);
  #chosen: YAxis | undefined;
  #isLog = false;
  #drawn: DrawnAxis | undefined;

  /** @param period value at which all of its signals wrap; 0: not all do */
  constructor(spec: AxisSpec, period: number, state: AxisState) {
    this.spec = spec;
    this.#state = state;
    this.#scale = new Scale(20 * 10 ** -spec.decimals, period);
    this.gutter = yGutter(spec, state, () => this.#drawn);
    showAxis(this.gutter, spec, undefined);
  }

  /** The fixed range, if one was chosen. */
  get range(): readonly [number, number] | undefined {
    return this.#chosen?.range;
  }

  /** Position of a value, CSS px from the plot's top. */
  y(value: number): number {
    return yOf(this.vertical, value);
  }

  /** Take over another choice; true if it is another one. */
  follow(): boolean {
    const chosen = this.#state.yAxes.peek().get(this.spec.key);
    if (chosen === this.#chosen) return false;
    if (chosen?.isLog !== this.#chosen?.isLog) this.#scale.reset();
    this.#chosen = chosen;
    showAxis(this.gutter, this.spec, chosen);
    return true;
  }

  /** Adapt to the extent of the data; true if the scale changed. */
  rescale(lo: number, hi: number, now: number, zoomed: boolean): boolean {
    [this.lowest, this.highest] = [lo, hi];
    const wasLog = this.#isLog;
    this.#isLog = isLogarithmic(this.#chosen, lo);
    const changed = this.#isLog
      ? this.#decades.update(Math.log10(lo), Math.log10(hi), now, zoomed)
      : this.#scale.update(lo, hi, now, zoomed);
    return changed || wasLog !== this.#isLog;
  }

  /** Lay the axis out. */
  place(top: number, height: number): void {
    const { lo, hi } = this.#ends();
    this.vertical = { top, hi, k: height / (hi - lo), isLog: this.#isLog };
    this.#drawn = { range: this.#isLog ? [10 ** lo, 10 ** hi] : [lo, hi], isLog: this.#isLog, top, height };
  }

  /** Labels: zero and, for an acceleration, 1 g take precedence. */
  labels(height: number): { readonly value: number; readonly text: string }[] {
    const { lo, hi } = this.#ends();
    if (this.#isLog) return [...logTicks(lo, hi)];
    const all = ticks(lo, hi, height, this.spec.unit === "°");
    const labels = all.map(({ value, decimals }) => ({ value, text: number(value, decimals) }));
    const [first, second] = [all[0], all[1]];
    const wide = first !== undefined && second !== undefined && Math.abs(second.value - first.value) >= 2;
    if (this.spec.unit !== "m/s²" || !wide || hi < STANDARD_GRAVITY || lo > STANDARD_GRAVITY) return labels;
    const g = { value: STANDARD_GRAVITY, text: "g" };
    const near = labels.filter(({ value }) => Math.abs(value - STANDARD_GRAVITY) > (hi - lo) / 40); // a line at 10 would touch it
    return near[0]?.value === 0 ? [near[0], g, ...near.slice(1)] : [g, ...near];
  }

  /** Ends of the axis: powers of ten on a logarithmic one. */
  #ends(): { readonly lo: number; readonly hi: number } {
    const range = this.range;
    if (range === undefined) return this.#isLog ? this.#decades : this.#scale;
    return this.#isLog ? { lo: Math.log10(range[0]), hi: Math.log10(range[1]) } : { lo: range[0], hi: range[1] };
  }
}
