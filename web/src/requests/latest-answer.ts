/**
 * The answer of the server to a question that keeps changing, and what of it may be shown: a result belongs to its question.
 *
 *     question ──▶ ask ──▶ answer ──▶ shown while it is the question's
 *                            │           dimmed once another one is asked, or while the server is gone
 *                            └─ refused ──▶ the error takes its place
 */
import { signal } from "@preact/signals";
import type { HttpProblem, Outcome } from "./http";

/** A question is asked after it has stood still for this long, ms, and a changing one this often. */
const REST_MS = 150;
const MOVING_MS = 600;
const PATIENCE_MS = 3000;

export interface Shown<A> {
  /** Undefined before the first, and where an error has taken its place. */
  readonly answer: A | undefined;
  /** Whether it is shown dimmed: it answers another question, or a server that has gone. */
  readonly isOld: boolean;
  /** Why this question has no answer, or no newer one. */
  readonly problem: HttpProblem | undefined;
}

/** Whether that is said of the server, or of the proxy before it, and not of the question. */
const isAway = ({ status }: HttpProblem): boolean => status === 0 || status >= 500;

interface Given<T> {
  readonly question: string;
  readonly is: T;
}

type Ask<A> = (over: AbortSignal) => Promise<Outcome<A>>;

export class LatestAnswer<A> {
  readonly #held = signal<Given<A> | undefined>(undefined);
  readonly #failed = signal<Given<HttpProblem> | undefined>(undefined);
  readonly #over = new AbortController();
  #isBusy = false;
  #wanted = "";
  #asked = "";
  #since = -Infinity;
  #began = -Infinity;
  #notBefore = -Infinity;

  /** What may be shown while that is the question. Reads signals. */
  of(question: string): Shown<A> {
    const [held, failed] = [this.#held.value, this.#failed.value];
    const problem = failed?.question === question ? failed.is : undefined;
    const isOwn = held?.question === question;
    if (problem && !(isOwn && isAway(problem))) return { answer: undefined, isOld: false, problem };
    return { answer: held?.is, isOld: held !== undefined && (!isOwn || problem !== undefined), problem };
  }

  get isEmpty(): boolean {
    return this.#held.peek() === undefined;
  }

  /** Take an answer. */
  take(question: string, outcome: Outcome<A>): void {
    this.#failed.value = outcome.ok ? undefined : { question, is: outcome.problem };
    if (outcome.ok) this.#held.value = { question, is: outcome.value };
  }

  /**
   * Ask if it is due, one request at a time; call it repeatedly, `now` in ms.
   *
   * @param turn asked again when that changes: the data goes on, and the question stays
   */
  want(question: string, now: number, ask: Ask<A>, turn = ""): void {
    const wanted = `${question} ${turn}`;
    if (wanted !== this.#wanted) [this.#wanted, this.#since] = [wanted, now];
    const isDue = now - this.#since >= REST_MS || now - this.#began >= MOVING_MS;
    if (wanted === this.#asked || this.#isBusy || !isDue || now < this.#notBefore) return;
    [this.#began, this.#isBusy] = [now, true];
    void ask(this.#over.signal)
      .then((outcome) => {
        if (this.#over.signal.aborted) return;
        this.take(question, outcome);
        if (outcome.ok) this.#asked = wanted;
        else this.#notBefore = now + PATIENCE_MS;
      })
      .finally(() => (this.#isBusy = false));
  }

  dispose(): void {
    this.#over.abort();
  }
}
