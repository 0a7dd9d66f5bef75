/**
 * Frames after a reconnect, held back until the gap before them is filled.
 *
 *     begin ──▶ take: frames wait ──▶ end, when the server has sent all that was missed, or after `REFILL_S`
 *                                      └──▶ keep: what was missed, oldest block first, then what came meanwhile
 */
import type { SampleFrame } from "../wire/codec";

/** A refill is not waited for longer than this: a plot that stands still says less than one with a gap. */
const REFILL_S = 3;

interface Waiting {
  readonly history: SampleFrame[];
  readonly live: SampleFrame[];
  readonly timer: ReturnType<typeof setTimeout>;
}

export class Refill {
  readonly #keep: (frame: SampleFrame) => void;
  #waiting: Waiting | undefined;

  /** @param keep where frames go when the waiting is over */
  constructor(keep: (frame: SampleFrame) => void) {
    this.#keep = keep;
  }

  /** Hold back what comes from now on. */
  begin(): void {
    this.end();
    this.#waiting = { history: [], live: [], timer: setTimeout(() => this.end(), 1000 * REFILL_S) };
  }

  /** Take a frame, which is held back if something is waited for. */
  take(frame: SampleFrame): void {
    if (this.#waiting !== undefined) (frame.history ? this.#waiting.history : this.#waiting.live).push(frame);
    else this.#keep(frame);
  }

  /** Put what was held back into the rings: history came newest block first, so it goes in backwards. */
  end(): void {
    const waiting = this.#waiting;
    if (waiting === undefined) return;
    this.#waiting = undefined;
    clearTimeout(waiting.timer);
    for (const frame of waiting.history.reverse()) this.#keep({ ...frame, history: false });
    for (const frame of waiting.live) this.#keep(frame);
  }
}
