/** Marks of losses on a canvas. Pure. */

/** Opacity of a mark of which hardly anything is lost: it is still seen. */
const LEAST_SHARE = 0.4;

export interface LossMark {
  /** px */
  readonly from: number;
  readonly to: number;
  /** Opacity: the share of it that is lost. */
  readonly share: number;
}

/**
 * A mark for losses that touch, none narrower than `least`: 3 % loss that fills a strip does not look like all of it.
 *
 * @param placed ends of the losses, px, in order
 */
export function lossMarks(placed: readonly (readonly [number, number])[], least: number): readonly LossMark[] {
  const marks: { from: number; to: number; lost: number }[] = [];
  for (const [a, b] of placed) {
    const grow = Math.max(0, least - (b - a)) / 2;
    const last = marks.at(-1);
    if (last && a - grow <= last.to) {
      last.lost += Math.max(0, b - Math.max(a, last.to - grow));
      last.to = Math.max(last.to, b + grow);
    } else marks.push({ from: a - grow, to: b + grow, lost: b - a });
  }
  return marks.map(({ from, to, lost }) => ({
    from,
    to,
    share: Math.min(1, Math.max(LEAST_SHARE, lost / (to - from))),
  }));
}
