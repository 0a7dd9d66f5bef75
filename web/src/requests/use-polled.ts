/** What the server is asked for while it is shown, once or again and again, and changes of it, whose answer is the new state. */
import { type ReadonlySignal, type Signal, useComputed, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { HttpProblem, Outcome } from "./http";

export interface Polled<T> {
  /** Undefined until the first answer. */
  readonly state: Signal<T | undefined>;
  /** Why the last change was refused, until the next; or why there is no newer state. */
  readonly problem: ReadonlySignal<HttpProblem | undefined>;
  /** Take the answer to a change; whether it was made. */
  readonly send: (change: Promise<Outcome<T>>) => Promise<boolean>;
}

/**
 * @param of its key: requested again when that changes
 * @param everyMs pause between two questions, perhaps of the newest state; undefined: that one stays
 */
export function usePolled<T>(
  of: string,
  everyMs: number | undefined | ((newest: T | undefined) => number | undefined),
  ask: (over: AbortSignal) => Promise<Outcome<T>>,
): Polled<T> {
  const state = useSignal<T | undefined>(undefined);
  const refused = useSignal<HttpProblem | undefined>(undefined);
  const away = useSignal<HttpProblem | undefined>(undefined);
  const changes = useRef(0);
  // biome-ignore lint/correctness/useExhaustiveDependencies: signals stay the same, and the question is that of the first time
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    const over = new AbortController();
    const look = async (): Promise<void> => {
      const before = changes.current;
      const outcome = await ask(over.signal);
      if (over.signal.aborted) return;
      const newest = outcome.ok ? outcome.value : state.peek();
      const pause = typeof everyMs === "function" ? everyMs(newest) : everyMs;
      if (pause !== undefined) timer = setTimeout(() => void look(), pause);
      if (before !== changes.current) return; // asked before the change was made: it would be shown undone
      away.value = outcome.ok ? undefined : outcome.problem;
      if (outcome.ok) state.value = outcome.value;
    };
    state.value = refused.value = undefined;
    void look();
    return () => {
      over.abort();
      clearTimeout(timer);
    };
  }, [of]);
  const send: Polled<T>["send"] = async (change) => {
    const outcome = await change;
    changes.current += 1;
    refused.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) state.value = outcome.value;
    return outcome.ok;
  };
  return { state, problem: useComputed(() => refused.value ?? away.value), send };
}
