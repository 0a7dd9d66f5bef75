/**
 * The bar that goes to a moment: a time, or the next and previous sample, event, marker, gap, or place where a condition is true.
 * The server looks for conditions: over a whole recording, or over what it has of a live device in memory.
 */
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { day, duration } from "../../plots/axis";
import { Button } from "../../ui/controls/button";
import { Select } from "../../ui/controls/choices";
import { clock } from "../../ui/format/format";
import { type HttpProblem, request } from "../../requests/http";
import { IconButton } from "../../ui/controls/icon-button";
import { Message } from "../../ui/controls/message";
import type { SignalFigures } from "../../wire/routes";
import type { UnderPlots } from "../../plots/under-plots";
import { type Destination, type GoToBar, stateOf } from "./state";
import { TEXT } from "./texts";
import "./go-to.css";

const KINDS: readonly Destination[] = ["sample", "event", "marker", "gap", "condition"];

export function GoTo({ deps }: { readonly deps: UnderPlots }) {
  const { actions } = deps.viewState;
  const { bar: goTo, steps } = stateOf(deps.viewState);
  // of the view: the page of a recording is rebuilt when more of it has been decoded
  const say = (said: GoToBar["said"]): void => {
    goTo.value = { ...goTo.peek(), said };
  };
  const asked = useRef(0);
  const input = useRef<HTMLInputElement>(null);
  const step = (ahead: boolean): void => {
    const forward = ahead && !isNow(deps); // nothing comes after now: the newest place is gone to
    const { kind } = goTo.peek();
    if (!goTo.peek().isOpen) goTo.value = { ...goTo.peek(), isOpen: true };
    asked.current += 1;
    deps.halt?.();
    if (kind === "sample") {
      actions.stepSample(ahead ? 1 : -1);
      say(undefined);
    } else if (kind === "condition") void search(forward, asked.current);
    else {
      const found = neighbour(deps.places(kind), reference(deps), forward);
      if (found !== undefined) actions.goTo(found);
      say({ words: found === undefined ? TEXT.none(TEXT.kinds[kind], forward) : TEXT.at(clock(found, 3)) });
    }
  };
  const search = async (forward: boolean, turn: number): Promise<void> => {
    const text = goTo.peek().text.trim();
    if (text === "" || momentOf(text, 0) !== undefined) {
      say({ words: TEXT.needsCondition });
      input.current?.focus();
      return;
    }
    say({ words: TEXT.searching });
    const device = deps.viewState.device.peek();
    const found = await placeOf(text, reference(deps), forward, deps);
    if (turn !== asked.current) return;
    if (deps.viewState.device.peek() !== device) return say(undefined); // a place of another device than is shown now
    if ("problem" in found) {
      say(found);
      const place = mistakeIn(text, found.problem.message);
      if (place) input.current?.focus();
      if (place) input.current?.setSelectionRange(...place);
      return;
    }
    if (found.begin !== undefined) actions.goTo(found.begin);
    say({ words: wordsOfPlace(found, forward) });
  };
  const submit = (forward: boolean): void => {
    const text = goTo.peek().text.trim();
    const at = momentOf(text, reference(deps));
    if (at === undefined) {
      if (text !== "") goTo.value = { ...goTo.peek(), kind: "condition" };
      return step(forward);
    }
    const bounds = actions.bounds();
    if (bounds !== undefined && (at < bounds.first || at > bounds.last)) {
      say({ words: TEXT.outside(...wordsOf(bounds)) });
      return;
    }
    deps.halt?.();
    actions.goTo(at);
    say({ words: TEXT.at(clock(at, 3)) });
  };
  // biome-ignore lint/correctness/useExhaustiveDependencies: a view has one bar
  useEffect(() => {
    steps.go = step;
    return () => (steps.go = () => undefined);
  }, []);
  const { isOpen, text, kind, said } = goTo.value;
  const isTyped = useRef(isOpen);
  // before the next key: what is typed at once belongs to the input, not to the page
  useLayoutEffect(() => {
    const field = input.current;
    if (isOpen && isTyped.current) {
      field?.focus();
      field?.setSelectionRange(field.value.length, field.value.length);
    } else if (isOpen) field?.select();
    isTyped.current = false;
  }, [isOpen]);
  if (!isOpen) return null;
  const close = (): void => {
    goTo.value = { ...goTo.peek(), isOpen: false, said: undefined };
  };
  const problem = said !== undefined && "problem" in said ? said.problem : undefined;
  return (
    <form
      class="go-to flex-row text-sm"
      aria-label={TEXT.title}
      onSubmit={(event) => {
        event.preventDefault();
        submit(true);
      }}
      onKeyDown={(event) => {
        if (event.key === "Escape") close();
        else if (event.key === "Enter" && event.shiftKey) submit(false);
        else return;
        event.preventDefault();
        event.stopPropagation();
      }}
    >
      <span class="field">
        <input
          ref={input}
          type="text"
          aria-label={TEXT.label}
          title={TEXT.hint}
          placeholder={TEXT.placeholder}
          value={text}
          spellcheck={false}
          autocomplete="off"
          aria-invalid={problem !== undefined}
          onInput={(event) => (goTo.value = { ...goTo.peek(), text: event.currentTarget.value })}
        />
      </span>
      <Button type="submit" look="edge" words={TEXT.go} />
      <IconButton icon="back" label={TEXT.previous} onClick={() => step(false)} />
      <Select
        label={TEXT.kind}
        value={kind}
        options={KINDS.map((one) => [one, TEXT.kinds[one]])}
        onChoose={(one) => (goTo.value = { ...goTo.peek(), kind: one })}
      />
      <IconButton icon="forward" label={TEXT.next} onClick={() => step(true)} />
      <span class={problem ? "go-to-said bad" : "go-to-said"} role="status">
        {problem ? (
          <>
            <Message text={problem.message} /> <Message text={problem.hint} />
          </>
        ) : (
          said !== undefined && "words" in said && said.words
        )}
      </span>
      <IconButton icon="close" label={TEXT.close} onClick={close} />
    </form>
  );
}

/** Where the next and the previous place are counted from. */
function reference({ viewState: { actions } }: UnderPlots): number {
  return actions.cursorTime() ?? actions.rightEdge();
}

/** Whether the live edge is where places are counted from. */
function isNow({ viewState: { actions, view } }: UnderPlots): boolean {
  return view.peek().live && actions.cursorTime() === undefined;
}

function wordsOf({ first, last }: { readonly first: number; readonly last: number }): readonly [string, string] {
  const isOneDay = day(first) === day(last);
  const words = (t: number): string => (isOneDay ? clock(t) : `${day(t)} ${clock(t)}`);
  return [words(first), words(last)];
}

type Place = { readonly begin: number | undefined; readonly end: number; readonly more: number };

function wordsOfPlace({ begin, end, more }: Place, forward: boolean): string {
  if (begin === undefined) return TEXT.neverTrue(forward);
  const time = clock(begin, 3);
  return begin === end ? TEXT.trueOnce(time, more) : TEXT.trueFor(time, duration(end - begin), more);
}

/** The next or previous place where a condition is true. */
async function placeOf(
  text: string,
  from: number,
  forward: boolean,
  { viewState, source }: UnderPlots,
): Promise<Place | { readonly problem: HttpProblem }> {
  const { device, timeBase: base } = viewState.view.peek();
  const options = { [forward ? "after" : "before"]: from, order: forward ? "ascending" : "descending", limit: 1 };
  const body = { source: source(), signals: [text], t0: null, t1: null, base, device: device ?? "", options };
  const outcome = await request("POST /api/analysis/{name}", { path: { name: "intervals" }, body });
  if (!outcome.ok) return { problem: outcome.problem };
  // of a vector each axis has its own: the nearest one is gone to
  const found = (outcome.value as readonly SignalFigures[]).map(({ figures }) => ({
    begin: (figures["begin"] as readonly number[])[0],
    end: (figures["end"] as readonly number[])[0] ?? NaN,
    more: Number(figures["total"]) - 1,
  }));
  const first = found
    .filter(({ begin }) => begin !== undefined)
    .sort((a, b) => (forward ? 1 : -1) * ((a.begin ?? 0) - (b.begin ?? 0)))[0];
  return first ?? { begin: undefined, end: NaN, more: 0 };
}

const RELATIVE = /^([+\-−])\s*(\d+(?:\.\d*)?|\.\d+)\s*(ms|s|min|h)?$/;
const CLOCK = /^(?:(\d{4}-\d{2}-\d{2})[T ])?(\d{1,2}):(\d{2})(?::(\d{2}(?:\.\d*)?))?\s*(?:Z|UTC)?$/;
const UNIX = /^\d{9,10}(?:\.\d*)?$/;
const SECONDS: Readonly<Record<string, number>> = { ms: 1e-3, s: 1, min: 60, h: 3600 };
const DAY_S = 86_400;

/**
 * The moment that a text means, unix s; undefined if it means none.
 *
 * @param from what a relative time is counted from; a time without its date is on that day
 */
export function momentOf(text: string, from: number): number | undefined {
  const typed = text.trim();
  if (UNIX.test(typed)) return Number(typed);
  const relative = RELATIVE.exec(typed);
  if (relative !== null) {
    const [, sign, amount, unit = "s"] = relative;
    return from + (sign === "+" ? 1 : -1) * Number(amount) * (SECONDS[unit] ?? 1);
  }
  const clock = CLOCK.exec(typed);
  if (clock === null) return undefined;
  const [, date, hours, minutes, seconds = "0"] = clock;
  const time = [Number(hours), Number(minutes), Number(seconds)] as const;
  if (time[0] > 23 || time[1] > 59 || time[2] >= 60) return undefined;
  const day = date === undefined ? Math.floor(from / DAY_S) * DAY_S : Date.parse(`${date}T00:00:00Z`) / 1000;
  return Number.isFinite(day) ? day + time[0] * 3600 + time[1] * 60 + time[2] : undefined;
}

/** The first of some times after `t`, or the last before it; undefined if there is none. */
export function neighbour(times: readonly number[], t: number, forward: boolean): number | undefined {
  const beyond = times.filter((one) => (forward ? one > t + SAME_S : one < t - SAME_S));
  return beyond.length === 0 ? undefined : beyond.reduce((a, b) => (forward ? Math.min(a, b) : Math.max(a, b)));
}

/** Times closer than this are the same: twice the resolution of a unix time in a 64-bit float, s. */
const SAME_S = 1e-6;

/** Where a mistake is in an expression, as the server says: "… (character 6)"; from there to the end of the word. */
export function mistakeIn(text: string, message: string): readonly [number, number] | undefined {
  const at = Number(/\(character (\d+)\)/.exec(message)?.[1] ?? NaN) - 1;
  if (!(at >= 0 && at <= text.length)) return undefined;
  const word = /^[\p{L}_][\w.]*|^[\d.]+|^./u.exec(text.slice(at))?.[0] ?? "";
  return [at, at + Math.max(1, word.length)];
}
