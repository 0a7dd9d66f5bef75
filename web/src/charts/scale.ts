/**
 * The span of a plot's y axis and its grid lines.
 *
 * The scale widens at once, because a trace must not leave its plot, and narrows only after NARROW_MS of spare room, so that the scale
 * does not change while the user reads it. Its ends are multiples of a quarter of the tick step, so that noise does not move it.
 */

/** Spare room must last this long before the scale narrows (design, "Live"). */
const NARROW_MS = 5000;
/** The scale has spare room when the data need less than this part of it. */
const MIN_FILLED_SHARE = 0.66;
/** Room above and below the data. */
const PAD_SHARE = 0.07;
/** Fraction of its circle from which a wrapping quantity counts as going round. */
const ROUNDED_SHARE = 0.7;

/** Steps of a circle from ten degrees up. */
const DEGREES: readonly number[] = [10, 15, 30, 45, 90, 180, 360];

/** 1, 2 or 5 times a power of ten, at least `least`; for angles in ° a part of a circle. */
export function niceStep(least: number, degrees = false): number {
  if (!(least > 0) || !Number.isFinite(least)) return 1;
  const part = degrees && least > 5 ? DEGREES.find((step) => step >= least) : undefined;
  if (part !== undefined) return part;
  const power = 10 ** Math.floor(Math.log10(least));
  for (const m of [1, 2, 5]) if (m * power >= least * (1 - 1e-9)) return m * power;
  return 10 * power;
}

export class Scale {
  lo = 0;
  hi = 1;
  #set = false;
  #spareSince: number | undefined;

  /**
   * @param least the smallest span shown: below it only noise of the last digit would be visible
   * @param period value at which the quantity wraps, 0 for never: one that goes round is shown on its whole circle
   */
  constructor(
    readonly least: number,
    readonly period = 0,
  ) {}

  /**
   * Adapt to the data's extent.
   * @param now ms; @param at once narrow without waiting (the user zoomed the window)
   * @returns whether the scale changed
   */
  update(lo: number, hi: number, now: number, atOnce: boolean): boolean {
    if (!(lo <= hi)) return false;
    if (this.period > 0 && hi - lo > ROUNDED_SHARE * this.period) {
      const edge = this.period / 36;
      return lo < 0
        ? this.#take(-this.period / 2 - edge, this.period / 2 + edge)
        : this.#take(-edge, this.period + edge);
    }
    const span = Math.max(hi - lo, this.least, Math.abs(hi + lo) * 1e-9);
    const middle = (lo + hi) / 2;
    const half = Math.max((hi - lo) / 2, span / 2) + span * PAD_SHARE;
    const step = niceStep(half / 2) / 4;
    const [a, b] = [Math.floor((middle - half) / step) * step, Math.ceil((middle + half) / step) * step];
    if (!this.#set || atOnce) return this.#take(a, b);
    if (a < this.lo || b > this.hi) {
      // widen only the end that needs it; the padding alone does not move the scale
      if (lo < this.lo || hi > this.hi) return this.#take(Math.min(a, this.lo), Math.max(b, this.hi));
    }
    if (b - a >= MIN_FILLED_SHARE * (this.hi - this.lo)) this.#spareSince = undefined;
    else if (this.#spareSince === undefined) this.#spareSince = now;
    else if (now - this.#spareSince > NARROW_MS) return this.#take(a, b);
    return false;
  }

  /** Reset; the next data sets the scale. */
  reset(): void {
    this.#set = false;
  }

  #take(lo: number, hi: number): boolean {
    const changed = !this.#set || lo !== this.lo || hi !== this.hi;
    [this.lo, this.hi, this.#set, this.#spareSince] = [lo, hi, true, undefined];
    return changed;
  }
}

interface Tick {
  readonly value: number;
  /** Decimals of its label. */
  readonly decimals: number;
}

/** Ticks of a scale `height` px high, about `apart` px from each other; zero first, its label takes precedence. */
export function ticks(lo: number, hi: number, height: number, degrees = false, apart = 17): Tick[] {
  const step = niceStep(((hi - lo) * apart) / Math.max(height, apart), degrees);
  const decimals = Math.min(9, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  const out: Tick[] = [];
  for (let k = Math.ceil(lo / step); k * step <= hi; k++) out.push({ value: k * step, decimals });
  return out.sort((a, b) => Number(b.value === 0) - Number(a.value === 0));
}
