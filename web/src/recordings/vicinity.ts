/**
 * Unsummarised samples around one moment of a recording, for a cursor, however little of it the window on screen holds.
 *
 *     around(t) ── within what is held? ──▶ nothing to do
 *               └─ no ──▶ one WindowFetcher for each group of channels (`nearOf`) ──▶ GET …/window ──▶ store
 */
import type { TimeBase } from "../data/view";
import { WindowFetcher } from "./window-fetcher";
import type { ReplayStore } from "./replay-store";
import { type Bounds, type Near, nearOf } from "./time-range";
import type { RecordingDetail } from "../wire/recording-types";

/** Shortest reach of samples around the cursor, s. */
const MIN_REACH_S = 0.02;
/** The server returns unsummarised rows if there are at most twice as many. */
const NEAR_WIDTH = 8000;
/** An outdated value is shown at most this long, ms. */
const PATIENCE_MS = 400;
/** In fast playback samples are requested at most this far ahead, in seconds of real time. */
const LONGEST_LEAD_S = 0.5;

/** Reading position, its clock, and recorded seconds per second. */
interface Moment {
  /** The selected device, and those of other signals on screen. */
  readonly devices: readonly string[];
  readonly time: number;
  readonly base: TimeBase;
  readonly speed: number;
}

interface NearWindow {
  readonly near: Near;
  readonly fetcher: WindowFetcher;
  /** Requested fraction of the range: less if samples are too dense. */
  share: number;
  /** Since when the reading position is not covered, ms; NaN while it is. */
  missing: number;
}

export class Vicinity {
  #around: readonly NearWindow[] = [];
  #devices = "";

  constructor(
    readonly detail: RecordingDetail,
    readonly store: ReplayStore,
    readonly bounds: Bounds,
  ) {}

  /** Why samples are missing. */
  get problem(): WindowFetcher["problem"] {
    return this.#around.find(({ fetcher }) => fetcher.problem)?.fetcher.problem;
  }

  /** Load the samples around a moment; call it every frame, `now` in ms. */
  around({ devices, time, base, speed }: Moment, now: number): void {
    if (devices.join("\n") !== this.#devices) this.#choose(devices);
    for (const around of this.#around) {
      const { near, fetcher } = around;
      const { held } = fetcher;
      if (held && !held.exact && around.share * near.before > MIN_REACH_S) {
        around.share /= 2;
        fetcher.held = undefined;
      }
      const reach = around.share * near.before;
      this.#forgetOld(around, time, now);
      const here =
        held &&
        fetcher.holds(near.channels, base) &&
        held.stretch.t0 <= Math.max(time - 0.3 * reach, this.bounds.first - 1);
      if (
        here &&
        fetcher.held &&
        held.stretch.t1 >= Math.min(time + Math.min(0.3 * speed, 0.3 * reach), this.bounds.last)
      ) {
        fetcher.problem = undefined;
        continue;
      }
      // the reading position when the answer arrives
      const lead = speed * Math.min(LONGEST_LEAD_S, (fetcher.took || 0) / 1000);
      const middle = Math.min(time + lead, this.bounds.last);
      fetcher.ask({
        stretch: { t0: middle - reach, t1: middle + reach, width: NEAR_WIDTH },
        channels: near.channels,
        base,
      });
    }
  }

  /** The samples of a channel, if all of them in a range are loaded. */
  isWhole(channel: number, from: number, to: number): boolean {
    const held = this.#around.find(({ near }) => near.channels.includes(channel))?.fetcher.held;
    return (
      held?.exact === true &&
      held.stretch.t0 <= Math.max(from, this.bounds.first) &&
      held.stretch.t1 >= Math.min(to, this.bounds.last)
    );
  }

  /** Call it when more of the recording is decoded. */
  refresh(): void {
    for (const { fetcher } of this.#around) fetcher.held = undefined;
  }

  dispose(): void {
    for (const { fetcher } of this.#around) fetcher.dispose();
  }

  /** Drop values of another position after the time that an answer may take. */
  #forgetOld(around: NearWindow, time: number, now: number): void {
    const stretch = around.fetcher.held?.stretch;
    if (stretch === undefined || (time >= stretch.t0 && time <= stretch.t1)) {
      around.missing = NaN;
    } else if (!(now - around.missing < PATIENCE_MS)) {
      if (around.missing === around.missing) {
        this.store.forget(around.near.channels);
        around.fetcher.held = undefined;
      } else around.missing = now;
    }
  }

  #choose(devices: readonly string[]): void {
    this.#devices = devices.join("\n");
    this.dispose();
    const own = this.detail.channels.filter((info) => devices.includes(info.device));
    this.#around = nearOf(own, this.detail.longest_s).map((near) => ({
      near,
      fetcher: new WindowFetcher(this.detail.info.id, this.store),
      share: 1,
      missing: NaN,
    }));
  }
}
