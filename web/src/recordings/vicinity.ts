/**
 * Samples around one moment of a recording, as they came: what a cursor reads there, however little of it the window on screen holds.
 *
 *     around(t) ── within what is held? ──▶ nothing to do
 *               └─ no ──▶ one Feed for each group of channels (`nearOf`) ──▶ GET …/window ──▶ store
 */
import type { TimeBase } from "../data/view-state";
import type { Problem } from "../ui/http";
import { Feed } from "./window-fetcher";
import type { ReplayStore } from "./replay-store";
import { type Bounds, type Near, nearOf } from "./time-range";
import type { RecordingDetail } from "./types";

/** Shortest reach of samples around the cursor, s. */
const LEAST_REACH_S = 0.02;
/** The server gives rows as they are when there are at most twice as many. */
const NEAR_WIDTH = 8000;
/** A value that is no longer that of the moment is shown at most this long, ms. */
const PATIENCE_MS = 400;
/** Played quickly, samples are asked for at most this far ahead, in seconds of a person's time. */
const LONGEST_LEAD_S = 0.5;

/** Where it is read, by which clock, and how many seconds of the recording pass in a second. */
export interface Moment {
  readonly device: string | undefined;
  readonly time: number;
  readonly base: TimeBase;
  readonly speed: number;
}

interface Around {
  readonly near: Near;
  readonly feed: Feed;
  /** Share of the reach that is asked for: less where samples come too densely. */
  share: number;
  /** Since when what is read has not been among what is held, ms; NaN while it is. */
  missing: number;
}

export class Vicinity {
  #around: readonly Around[] = [];
  #device: string | undefined;

  constructor(
    readonly detail: RecordingDetail,
    readonly store: ReplayStore,
    readonly bounds: Bounds,
    /** Told of what is wrong. */
    readonly told: (problem: Problem) => void,
  ) {}

  /** Have the samples around a moment; to be called every frame, `now` in ms. */
  around({ device, time, base, speed }: Moment, now: number): void {
    if (device !== this.#device) this.#choose(device);
    for (const around of this.#around) {
      const { near, feed } = around;
      const { held } = feed;
      if (held && !held.exact && around.share * near.before > LEAST_REACH_S) {
        around.share /= 2;
        feed.held = undefined;
      }
      const reach = around.share * near.before;
      this.#forgetOld(around, time, now);
      const here = held && feed.holds(near.channels, base) && held.stretch.t0 <= Math.max(time - 0.3 * reach, this.bounds.first - 1);
      if (here && feed.held && held.stretch.t1 >= Math.min(time + Math.min(0.3 * speed, 0.3 * reach), this.bounds.last)) continue;
      // Where it will be read when the answer is here.
      const lead = speed * Math.min(LONGEST_LEAD_S, (feed.took || 0) / 1000);
      const middle = Math.min(time + lead, this.bounds.last);
      feed.ask({ stretch: { t0: middle - reach, t1: middle + reach, width: NEAR_WIDTH }, channels: near.channels, base });
    }
  }

  /** What is held of a channel, when that is all of its samples of a stretch. */
  isWhole(channel: number, from: number, to: number): boolean {
    const held = this.#around.find(({ near }) => near.channels.includes(channel))?.feed.held;
    return held !== undefined && held.exact && held.stretch.t0 <= Math.max(from, this.bounds.first) && held.stretch.t1 >= Math.min(to, this.bounds.last);
  }

  /** There is more of the recording by now. */
  refresh(): void {
    for (const { feed } of this.#around) feed.held = undefined;
  }

  dispose(): void {
    for (const { feed } of this.#around) feed.dispose();
  }

  /** A value from elsewhere in the recording is not shown for longer than an answer may take. */
  #forgetOld(around: Around, time: number, now: number): void {
    const stretch = around.feed.held?.stretch;
    if (stretch === undefined || (time >= stretch.t0 && time <= stretch.t1)) {
      around.missing = NaN;
    } else if (!(now - around.missing < PATIENCE_MS)) {
      if (around.missing === around.missing) {
        this.store.forget(around.near.channels);
        around.feed.held = undefined;
      } else around.missing = now;
    }
  }

  #choose(device: string | undefined): void {
    this.#device = device;
    this.dispose();
    const own = this.detail.channels.filter((info) => info.device === device);
    const told = (problem: Problem | undefined): void => {
      if (problem) this.told(problem);
    };
    this.#around = nearOf(own, this.detail.longest_s).map((near) => ({ near, feed: new Feed(this.detail.info.id, this.store, told), share: 1, missing: NaN }));
  }
}
