/** The sample that a cursor snaps to. */
import type { Ring } from "../data/ring-buffer";
import type { TimeBase } from "../data/view";

/** Time of the sample of a ring nearest to `t`; undefined if the ring holds none on one side, or only a summary, whose rows share their times. */
export function nearestSample(ring: Ring, t: number, base: TimeBase): number | undefined {
  const timeOf = (i: number): number => (base === "device" ? ring.time(i) : ring.arrival(i));
  const i = ring.indexAt(t, base);
  if (i >= 0 && timeOf(i) === t) return t;
  if (i < 0 || i + 1 >= ring.length) return undefined;
  const [before, after] = [timeOf(i), timeOf(i + 1)];
  if (after === timeOf(i + 2 < ring.length ? i + 2 : -1)) return undefined;
  return t - before <= after - t ? before : after;
}
