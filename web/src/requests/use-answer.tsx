/** What the server is asked for while it is shown, once or again and again, and changes of it, whose answer is the new state. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type { HttpProblem, Outcome } from "./http";
import { LatestAnswer, type Shown } from "./latest-answer";
import { ProblemNote } from "./problem-note";

export interface Asked<A> extends Shown<A> {
  /** Take the answer to a change; whether it was made. */
  readonly send: (change: Promise<Outcome<A>>) => Promise<boolean>;
  readonly isBusy: boolean;
}

const NOTHING = { answer: undefined, isOld: false, problem: undefined };

interface How<A> {
  /** Pause before the next time, ms, perhaps of the newest answer; undefined: once. */
  readonly everyMs?: number | ((newest: A | undefined) => number | undefined) | undefined;
  /** Pause before another question than the first, for more to be typed, ms. */
  readonly typedMs?: number;
}

/**
 * @param question all that the answer depends on, but for the data that goes on; "" is not asked, and has no result
 * @param ask undefined as answer: nothing has changed
 */
export function useAnswer<A>(
  question: string,
  ask: (over: AbortSignal) => Promise<Outcome<A> | undefined>,
  { everyMs, typedMs = 0 }: How<A> = {},
): Asked<A> {
  const latest = useMemo(() => new LatestAnswer<A>(), []);
  const refused = useSignal<HttpProblem | undefined>(undefined);
  const busy = useSignal(false);
  const changes = useRef(0);
  const newest = useRef(ask);
  newest.current = ask;
  // biome-ignore lint/correctness/useExhaustiveDependencies: the question stands for all that is asked
  useEffect(() => {
    refused.value = undefined;
    if (question === "") return undefined;
    let timer: ReturnType<typeof setTimeout> | undefined;
    const over = new AbortController();
    const look = async (): Promise<void> => {
      const before = changes.current;
      const outcome = await newest.current(over.signal);
      if (over.signal.aborted) return;
      busy.value = false;
      // asked before a change was made: it would be shown undone
      if (outcome && before === changes.current) latest.take(question, outcome);
      const { answer } = latest.of(question);
      const pause = typeof everyMs === "function" ? everyMs(answer) : everyMs;
      if (pause !== undefined) timer = setTimeout(() => void look(), pause);
    };
    busy.value = true;
    if (latest.isEmpty || typedMs === 0) void look();
    else timer = setTimeout(() => void look(), typedMs);
    return () => {
      over.abort();
      clearTimeout(timer);
    };
  }, [question]);
  const shown: Shown<A> = question === "" ? NOTHING : latest.of(question);
  const send: Asked<A>["send"] = async (change) => {
    const outcome = await change;
    changes.current += 1;
    refused.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) latest.take(question, outcome);
    return outcome.ok;
  };
  return { ...shown, problem: refused.value ?? shown.problem, send, isBusy: busy.value };
}

interface Props<A> {
  readonly of: Shown<A>;
  /** Stands for the first answer until it comes. */
  readonly waiting?: ComponentChildren;
  /** Under an error, in the place of a result. */
  readonly instead?: (problem: HttpProblem) => ComponentChildren;
  readonly children: (answer: A) => ComponentChildren;
}

/** A result, dimmed while it is not that of the question, and the error that takes its place. */
export function Answered<A>({ of: { answer, isOld, problem }, waiting, instead, children }: Props<A>) {
  return (
    <>
      {problem && <ProblemNote problem={problem} />}
      {problem && instead?.(problem)}
      {answer === undefined ? (
        !problem && waiting
      ) : (
        <div class="result" data-old={isOld || undefined} aria-busy={isOld}>
          {children(answer)}
        </div>
      )}
    </>
  );
}
