/**
 * The newest answer of the server to a question that keeps changing, as a range does while it is dragged: one request at a time, soon
 * after the question has stood still, and now and then while it moves.
 */
import type { Outcome, HttpProblem } from "../requests/http";

/** A question is asked after it has stood still for this long, ms, and a changing one this often. */
const REST_MS = 150;
const MOVING_MS = 600;
const PATIENCE_MS = 3000;

export class LatestAnswer<A> {
  problem: HttpProblem | undefined;
  held: { readonly question: string; readonly answer: A } | undefined;
  readonly #stop = new AbortController();
  #isBusy = false;
  #wanted = "";
  #since = -Infinity;
  #began = -Infinity;
  #notBefore = -Infinity;

  /** Ask if it is due; call it repeatedly, `now` in ms. */
  want(question: string, now: number, ask: (signal: AbortSignal) => Promise<Outcome<A>>): void {
    if (question !== this.#wanted) [this.#wanted, this.#since] = [question, now];
    const isDue = now - this.#since >= REST_MS || now - this.#began >= MOVING_MS;
    if (question === this.held?.question || this.#isBusy || !isDue || now < this.#notBefore) return;
    [this.#began, this.#isBusy] = [now, true];
    void ask(this.#stop.signal)
      .then((outcome) => {
        if (this.#stop.signal.aborted) return;
        this.problem = outcome.ok ? undefined : outcome.problem;
        if (outcome.ok) this.held = { question, answer: outcome.value };
        else this.#notBefore = now + PATIENCE_MS;
      })
      .finally(() => (this.#isBusy = false));
  }

  dispose(): void {
    this.#stop.abort();
  }
}
