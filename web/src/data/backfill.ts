/**
 * Holds frames back after a reconnect until the gap before them is filled.
 *
 *     begin ──▶ take: frames wait ──▶ end, when the server has sent the missed part, or after `REFILL_S`
 *                                      └──▶ keep: the missed part, oldest block first, then the frames held back
 */
import type { SampleFrame } from "../wire/codec";

/** Longest wait for a refill: a plot that stands still is worse than one with a gap. */
const REFILL_S = 3;

interface Waiting {
  readonly history: SampleFrame[];
  readonly live: SampleFrame[];
  readonly timer: ReturnType<typeof setTimeout>;
}

export class Backfill {
  readonly #keep: (frame: SampleFrame) => void;
  #waiting: Waiting | undefined;

  /** @param keep receives the frames after the wait */
  constructor(keep: (frame: SampleFrame) => void) {
    this.#keep = keep;
  }

  /** Start holding frames back. */
  begin(): void {
    this.end();
    this.#waiting = { history: [], live: [], timer: setTimeout(() => this.end(), 1000 * REFILL_S) };
  }

  /** Take a frame; it is held back during a refill. */
  take(frame: SampleFrame): void {
    if (this.#waiting !== undefined) (frame.history ? this.#waiting.history : this.#waiting.live).push(frame);
    else this.#keep(frame);
  }

  /** Put held frames into the rings: history came newest block first, so it goes in backwards. */
  end(): void {
    const waiting = this.#waiting;
    if (waiting === undefined) return;
    this.#waiting = undefined;
    clearTimeout(waiting.timer);
    for (const frame of waiting.history.reverse()) this.#keep({ ...frame, history: false });
    for (const frame of waiting.live) this.#keep(frame);
  }
}
