/**
 * Fetches samples of a recording into a store, one request at a time: while it is running the wanted range may change, and after its
 * answer the newest one is requested. The screen always shows the newest answer.
 */
import { decode } from "../wire/codec";
import type { HttpProblem } from "../requests/http";
import type { ReplayStore } from "./replay-store";
import { fetchWindow } from "./api";
import type { Stretch } from "./time-range";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/recordings";

/** Wait after a refusal before the same is requested again, ms. */
const PATIENCE_MS = 1500;

const OFFLINE: HttpProblem = { kind: "offline", message: COMMON.serverSilent, hint: TEXT.showingEarlier, status: 0 };

/** A request: a range of these channels, by one of the clocks. */
export interface FetchRequest {
  readonly stretch: Stretch;
  readonly channels: readonly number[];
  readonly base: "device" | "arrival";
}

export interface HeldWindow extends FetchRequest {
  readonly exact: boolean;
}

export class WindowFetcher {
  held: HeldWindow | undefined;
  /** Of the last answer, while something is missing. */
  problem: HttpProblem | undefined;
  /** Duration of the last request until its samples were in their rings, ms. */
  took = NaN;
  readonly #stop = new AbortController();
  #busy = false;
  #notBefore = -Infinity;

  constructor(
    readonly recording: string,
    readonly store: ReplayStore,
  ) {}

  /** Whether this matches the held data, apart from the range. */
  holds(channels: readonly number[], base: FetchRequest["base"]): boolean {
    const held = this.held;
    return (
      held !== undefined &&
      held.base === base &&
      held.channels.length === channels.length &&
      channels.every((id, k) => id === held.channels[k])
    );
  }

  /** Send the request, unless one is running; called every frame. */
  ask(request: FetchRequest): void {
    if (this.#busy || performance.now() < this.#notBefore || request.channels.length === 0) return;
    this.#busy = true;
    void this.#fetch(request).finally(() => (this.#busy = false));
  }

  dispose(): void {
    this.#stop.abort();
  }

  async #fetch(request: FetchRequest): Promise<void> {
    const began = performance.now();
    try {
      const answer = await fetchWindow(this.recording, { ...request.stretch, ...request }, this.#stop.signal);
      if (this.#stop.signal.aborted) return;
      if ("message" in answer) return this.#refused(answer.kind === OFFLINE.kind ? OFFLINE : answer);
      const { frames, problem } = decode(answer.buffer, this.store.dtypesOf);
      if (problem !== undefined)
        return this.#refused({ kind: "wire", message: problem, hint: TEXT.reloadPage, status: 0 });
      this.store.show(request.channels, frames, request.stretch, answer.exact);
      this.held = { ...request, exact: answer.exact };
      this.took = performance.now() - began;
      this.problem = undefined;
    } catch {
      if (this.#stop.signal.aborted) return;
      this.#refused(OFFLINE);
    }
  }

  #refused(problem: HttpProblem): void {
    this.#notBefore = performance.now() + PATIENCE_MS;
    this.problem = problem;
  }
}
