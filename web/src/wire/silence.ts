/**
 * Detection of a dead connection. The server sends its health twice a second in any case, so a connection silent for a little longer is
 * dead, although the socket reports it only much later: a cable was pulled out, a network is congested. Pure: the caller reports
 * received messages, and polls.
 */

/** Silence after this long, s: three reports are missing. */
export const SILENT_S = 1.5;
/** Polling interval, s. */
export const ASK_S = 0.25;
/** A longer pause between polls means that the page slept: waiting messages are processed first, s. */
const SLEPT_S = 1;

export class Silence {
  #received = NaN;
  #checked = NaN;
  #since: number | undefined;

  /** Report a message; true if it ends a silence. */
  receive(now: number): boolean {
    const ended = this.#since !== undefined;
    [this.#received, this.#since] = [now, undefined];
    return ended;
  }

  /** Start of the silence when it becomes relevant; undefined otherwise. */
  ask(now: number): number | undefined {
    const slept = !(now - this.#checked < SLEPT_S);
    this.#checked = now;
    if (slept || this.#since !== undefined || !(now - this.#received > SILENT_S)) return undefined;
    return (this.#since = this.#received);
  }
}
