/**
 * The last minute of health reports. They come twice a second; the recent ones are kept per device for the sidebar and the health
 * panel. Pure; fed once per report.
 */
import type { DeviceHealth } from "../wire/types";

/** One health report, reduced to the drawn values. */
export interface Moment {
  readonly time: number;
  readonly rate: number;
  readonly gaps: number;
  readonly lost: number;
  readonly rejects: number;
  readonly jitter: number | undefined;
  readonly drift: number | undefined;
}

export const MINUTE = 60;

export class RecentHealth {
  #moments = new Map<string, Moment[]>();

  /** Add a report; repeats are ignored. */
  add(health: DeviceHealth): void {
    const list = this.#moments.get(health.device) ?? [];
    const last = list.at(-1);
    if (last && health.time <= last.time) return;
    list.push({
      time: health.time,
      rate: health.rate,
      gaps: health.gaps,
      lost: health.lost,
      rejects: health.rejects,
      jitter: health.jitter_ms ?? undefined,
      drift: health.drift_ppm ?? undefined,
    });
    // one report older than the minute is kept, for the counters at its start
    while (list.length > 2 && (list[1]?.time ?? 0) < health.time - MINUTE) list.shift();
    this.#moments.set(health.device, list);
  }

  /** Set the whole last minute: for a recording it is known at once, at any reading position. */
  put(device: string, moments: readonly Moment[]): void {
    this.#moments.set(device, [...moments]);
  }

  /** Reports of the last minute, oldest first. */
  of(device: string): readonly Moment[] {
    return this.#moments.get(device) ?? [];
  }
}

/** A bar of a sparkline: height 0..1 and whether something was wrong in it; undefined if unknown. */
export interface HealthBar {
  readonly height: number;
  readonly bad: boolean;
}

/**
 * The minute before `now` in `n` bars: the mean rate of each, scaled by the minute's best; marked where samples were lost.
 * Bars before the first report are undefined, bars after the last report have height 0.
 */
export function rateBars(moments: readonly Moment[], now: number, n: number): readonly (HealthBar | undefined)[] {
  const best = Math.max(1e-9, ...moments.map((m) => m.rate));
  const bars: (HealthBar | undefined)[] = new Array<HealthBar | undefined>(n).fill(undefined);
  let bar = -1;
  let [sum, count, bad] = [0, 0, false];
  const close = (): void => {
    if (count > 0 && bar >= 0 && bar < n) bars[bar] = { height: sum / count / best, bad };
  };
  moments.forEach((moment, i) => {
    const at = Math.floor(((moment.time - (now - MINUTE)) / MINUTE) * n);
    if (at !== bar) {
      close();
      [bar, sum, count, bad] = [at, 0, 0, false];
    }
    sum += moment.rate;
    count += 1;
    const before = moments[i - 1];
    bad ||= before !== undefined && moment.lost > before.lost;
  });
  close();
  return filled(bars);
}

/** Reports come every half second: a bar between two known ones repeats the one before; past a second and a half it is loss. */
function filled(bars: (HealthBar | undefined)[]): readonly (HealthBar | undefined)[] {
  const patience = Math.ceil((1.5 / MINUTE) * bars.length);
  let [last, since]: [HealthBar | undefined, number] = [undefined, 0];
  return bars.map((bar) => {
    if (bar) {
      [last, since] = [bar, 0];
      return bar;
    }
    if (!last) return undefined;
    since += 1;
    return since <= patience ? { height: last.height, bad: false } : { height: 0, bad: true };
  });
}
