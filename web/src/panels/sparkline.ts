/** Sparklines of the last minute: small bars, grey if all was well, marked where samples were lost. */
import { css, type Surface } from "../ui/dom/canvas";
import type { HealthBar } from "../data/health-history";

/** Bars from the left; an unknown bar is empty, silence is a low mark. */
export function drawBars(to: Surface, bars: readonly (HealthBar | undefined)[], gone: boolean): void {
  if (!to.begin()) return;
  const x = to.context;
  const step = to.width() / bars.length;
  const height = to.height() - 2;
  const thick = Math.max(1, step - 0.75);
  bars.forEach((bar, i) => {
    if (!bar) {
      x.fillStyle = css("--line-strong");
      x.fillRect(i * step, height, thick, 1);
      return;
    }
    const silent = bar.height === 0;
    x.fillStyle = css(silent && gone ? "--status-bad" : bar.bad ? "--status-warn" : "--ink-3");
    // The full height stands for the best rate of the minute; a steady rate stands at 85 %, so that it reads as a level.
    const tall = silent ? 2 : Math.max(2, bar.height * 0.85 * height);
    x.fillRect(i * step, height + 1 - tall, thick, tall);
  });
}

/** Ticks where a counter went up. */
export function drawTicks(to: Surface, values: readonly (number | undefined)[]): void {
  if (!to.begin() || values.length < 2) return;
  const x = to.context;
  const step = to.width() / (values.length - 1);
  const base = to.height() - 2;
  for (let i = 1; i < values.length; i++) {
    const [before, after] = [values[i - 1], values[i]];
    const up = before !== undefined && after !== undefined && after > before;
    x.fillStyle = css(up ? "--loss" : "--line-strong");
    const left = (i - 1) * step;
    x.fillRect(left, up ? 1 : base - 1, Math.max(1, up ? Math.max(2, step - 0.75) : step - 0.75), up ? base : 1.5);
  }
}

/** A level over time, from zero. */
export function drawLevel(to: Surface, values: readonly (number | undefined)[], top: number): void {
  if (!to.begin() || values.length === 0) return;
  const x = to.context;
  const step = to.width() / values.length;
  const height = to.height() - 2;
  x.fillStyle = css("--ink-3");
  values.forEach((value, i) => {
    if (value === undefined) return;
    const tall = Math.max(1, Math.min(1, Math.abs(value) / top) * height);
    x.fillRect(i * step, height + 1 - tall, Math.max(1, step - 0.75), tall);
  });
}
