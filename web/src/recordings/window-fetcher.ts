/**
 * How do samples of a recording get into a store? One request at a time: while it is under way the wish may change, and when it is
 * answered the newest wish is asked for. What is on screen is always the newest answer.
 */
import { decode } from "../wire/codec";
import type { Problem } from "../ui/http";
import type { ReplayStore } from "./replay-store";
import { fetchWindow } from "./api";
import type { Stretch } from "./time-range";

/** After a refusal the same is not asked for again at once, ms. */
const PATIENCE_MS = 1500;

/** What is asked for: a stretch of these channels, by one of the clocks. */
export interface Wish {
  readonly stretch: Stretch;
  readonly channels: readonly number[];
  readonly base: "device" | "arrival";
}

export interface Held extends Wish {
  readonly exact: boolean;
}

export class Feed {
  held: Held | undefined;
  /** The last answer's way, from the request to samples in their rings, ms. */
  took = NaN;
  readonly #stop = new AbortController();
  #busy = false;
  #notBefore = -Infinity;

  constructor(
    readonly recording: string,
    readonly store: ReplayStore,
    /** Told of every answer: what was wrong, or undefined. */
    readonly told: (problem: Problem | undefined) => void,
  ) {}

  /** Is this what is held, but for the stretch? */
  holds(channels: readonly number[], base: Wish["base"]): boolean {
    const held = this.held;
    return held !== undefined && held.base === base && held.channels.length === channels.length && channels.every((id, k) => id === held.channels[k]);
  }

  /** Ask, unless something is being asked already: who wishes does so every frame. */
  ask(wish: Wish): void {
    if (this.#busy || performance.now() < this.#notBefore || wish.channels.length === 0) return;
    this.#busy = true;
    void this.#fetch(wish).finally(() => (this.#busy = false));
  }

  dispose(): void {
    this.#stop.abort();
  }

  async #fetch(wish: Wish): Promise<void> {
    const began = performance.now();
    try {
      const answer = await fetchWindow(this.recording, { ...wish.stretch, ...wish }, this.#stop.signal);
      if (this.#stop.signal.aborted) return;
      if ("message" in answer) return this.#refused(answer);
      const { frames, problem } = decode(answer.buffer, this.store.dtypesOf);
      if (problem !== undefined) return this.#refused({ kind: "wire", message: problem, hint: "Reload the page: it may be older than the server.", status: 0 });
      this.store.show(wish.channels, frames, wish.stretch, answer.exact);
      this.held = { ...wish, exact: answer.exact };
      this.took = performance.now() - began;
      this.told(undefined);
    } catch {
      if (this.#stop.signal.aborted) return;
      this.#refused({ kind: "offline", message: "The imuscope server does not answer.", hint: "What is on screen came before; it is tried again.", status: 0 });
    }
  }

  #refused(problem: Problem): void {
    this.#notBefore = performance.now() + PATIENCE_MS;
    this.told(problem);
  }
}
