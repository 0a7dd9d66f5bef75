/**
 * Is the server still heard? It tells its health twice a second whatever else there is to tell, so a connection over which nothing
 * comes for a little longer is dead, although no socket says so for a long time: a cable that was pulled out, a network that is
 * congested. Pure: who listens says when it heard something, and asks from time to time.
 */

/** Nothing was heard for this long, s: three reports are missing. */
export const SILENT_S = 1.5;
/** Asked this often, s. */
export const ASK_S = 0.25;
/** Who was not even asked for this long slept itself, and hears first what waits, s. */
const SLEPT_S = 1;

export class Silence {
  #heard = NaN;
  #asked = NaN;
  #since: number | undefined;

  /** Something came; true when that ends a silence. */
  hear(now: number): boolean {
    const ended = this.#since !== undefined;
    [this.#heard, this.#since] = [now, undefined];
    return ended;
  }

  /** Since when nothing was heard, when that begins to matter now; undefined otherwise. */
  ask(now: number): number | undefined {
    const slept = !(now - this.#asked < SLEPT_S);
    this.#asked = now;
    if (slept || this.#since !== undefined || !(now - this.#heard > SILENT_S)) return undefined;
    return (this.#since = this.#heard);
  }
}
