/** The form of a computed signal: its expression with a preview of the last seconds, its name, and what is wrong with it. */
import { useComputed, useSignal, type Signal } from "@preact/signals";
import { useEffect, useCallback, useRef } from "preact/hooks";
import type { Deps } from "../../page/context";
import { Button } from "../../ui/controls/button";
import { Dialog } from "../../ui/controls/dialog";
import { request, type HttpProblem, type Outcome } from "../../requests/http";
import { useAnswer } from "../../requests/use-answer";
import { number } from "../../ui/format/format";
import type { ComputedSignal, ExpressionWords, SignalFigures } from "../../wire/routes";
import { TEXT as SIGNALS } from "../../texts/signals";
import { expressionNames, completionsAt, mistakePlace } from "./completion";
import { sparkPath } from "../../signals/tree-rows";
import { TEXT } from "./texts";
import { CompletionList, completed } from "../../ui/completion/completion-list";
import { MarkedMistake } from "../../ui/completion/mistake";
import { useCompletion } from "../../ui/completion/use-completion";
import "./expressions.css";

/** Pause after typing, ms. */
const TYPED_MS = 250;
const PREVIEW_S = 5;
const [WIDTH, HEIGHT, INTERVALS, FIRST] = [480, 90, 160, 4];

interface Props {
  readonly deps: Deps;
  /** The signal that is edited; undefined: a new one. */
  readonly signal: ComputedSignal | undefined;
  readonly onClose: () => void;
  /** Called once it is computed. */
  readonly onMade: (name: string, columns: readonly string[]) => void;
}

export function NewSignal({ deps, signal, onClose, onMade }: Props) {
  const device = deps.viewState.device.value ?? "";
  const text = useSignal(signal?.expression ?? "");
  const name = useSignal(signal?.name ?? "");
  const refused = useSignal<HttpProblem | undefined>(undefined);
  const busy = useSignal(false);
  const names = useComputed(() => expressionNames(deps.store.channels.value, device, signal?.name));
  const words = useAnswer("words", (signal) => request("GET /api/signals/words", { signal })).answer;
  const expression = text.value.trim();
  const ask = async (signal: AbortSignal): Promise<Outcome<readonly SignalFigures[]>> => {
    // a plain name is a signal of its own; in brackets it is an expression, whose mistakes have a place
    const now = deps.store.edgeOf(device);
    const range = { t0: now - PREVIEW_S, t1: now, base: "device" as const };
    const body = { source: device, signals: [`(${expression})`], options: {}, ...range };
    const outcome = await request("POST /api/analysis/{name}", { path: { name: "expression" }, body, signal });
    return outcome.ok
      ? { ok: true, value: outcome.value as readonly SignalFigures[] }
      : { ok: false, problem: unbracketed(outcome.problem) };
  };
  const preview = useAnswer(expression && `${device} ${expression}`, ask, { typedMs: TYPED_MS });
  const figures = preview.answer;
  const save = async (): Promise<void> => {
    if (busy.peek() || text.peek().trim() === "") return;
    busy.value = true;
    const own = name.peek().trim() || usualName(text.peek());
    const path = { device, name: own };
    const body = { expression: text.peek().trim() };
    const outcome = await request("PUT /api/devices/{device}/signals/{name}", { path, body });
    busy.value = false;
    refused.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) return;
    onMade(own, columnsOf(figures ?? []));
    onClose();
  };
  const problem = refused.value ?? preview.problem;
  const mistake = problem ? `${problem.message} ${problem.hint}`.trim() : "";
  return (
    <Dialog title={signal ? TEXT.editSignal(signal.name) : TEXT.newSignal} onClose={onClose}>
      <form
        class="new-signal stacked"
        onSubmit={(event) => {
          event.preventDefault();
          void save();
        }}
      >
        <ExpressionInput text={text} names={names.value} words={words} mistake={mistake} onEnter={() => void save()} />
        <div class="result" data-old={preview.isOld || undefined}>
          <Preview figures={figures ?? []} />
        </div>
        <label class="labelled">
          <span>{TEXT.name}</span>
          <span class="field">
            <input
              type="text"
              value={name.value}
              maxLength={60}
              readOnly={signal !== undefined}
              placeholder={usualName(text.value)}
              autocomplete="off"
              onInput={(event) => (name.value = event.currentTarget.value)}
            />
          </span>
        </label>
        <p class="mid text-sm">{TEXT.causal}</p>
        <Button
          changes
          type="submit"
          look="main"
          words={signal ? TEXT.save : TEXT.saveAndPlot}
          disabled={busy.value || text.value.trim() === ""}
        />
      </form>
    </Dialog>
  );
}

/** Names of the columns of the channel that these figures describe. */
export function columnsOf(figures: readonly SignalFigures[]): readonly string[] {
  return figures.length < 2 ? ["value"] : figures.map(({ signal }) => signal.slice(signal.lastIndexOf(".") + 1));
}

/** A name for a signal without one: its expression, without what a name cannot have. */
export function usualName(expression: string): string {
  return expression.replace(/["'/]/g, " ").replace(/\./g, " ").replace(/\s+/g, " ").trim().slice(0, 60).trim();
}

/** The place of a mistake without the bracket before the expression. */
function unbracketed(problem: HttpProblem): HttpProblem {
  const message = problem.message.replace(
    /\(character (\d+)\)/,
    (_, at) => `(character ${Math.max(1, Number(at) - 1)})`,
  );
  return { ...problem, message };
}

function Preview({ figures }: { readonly figures: readonly SignalFigures[] }) {
  const first = figures[0];
  const shown = figures.map(({ signal, figures: of, units }) => {
    const value = (of["values"] as readonly (number | null)[] | undefined) ?? [];
    return { signal, value, unit: units["values"] ?? "" };
  });
  const all = shown.flatMap(({ value }) => value.filter((one) => one !== null));
  const range = { least: Math.min(...all), greatest: Math.max(...all) };
  return (
    <div class="signal-preview" aria-live="off">
      <svg viewBox={`0 -2 ${WIDTH} ${HEIGHT + 4}`} role="img" aria-label={TEXT.preview(PREVIEW_S)}>
        {shown.map(({ signal, value }, k) => (
          <path
            key={signal}
            class={AXES[k % AXES.length] ?? "axis-n"}
            d={sparkPath(extremes(value), WIDTH, HEIGHT, range)}
          />
        ))}
      </svg>
      <p>
        {first === undefined
          ? TEXT.previewHint
          : shown.map(({ signal, value, unit }) => (
              <span key={signal}>
                {value
                  .slice(0, FIRST)
                  .map((one) => number(one ?? NaN, 4))
                  .join("  ")}{" "}
                … <b class="unit">{unit || SIGNALS.noUnit}</b>
              </span>
            ))}
      </p>
    </div>
  );
}

const AXES = ["axis-x", "axis-y", "axis-z", "axis-n"];

function extremes(values: readonly (number | null)[]): { readonly lo: Float64Array; readonly hi: Float64Array } {
  const n = Math.min(INTERVALS, values.length);
  const [lo, hi] = [new Float64Array(n).fill(NaN), new Float64Array(n).fill(NaN)];
  values.forEach((value, i) => {
    if (value === null) return;
    const k = Math.floor((i * n) / values.length);
    if (!((lo[k] ?? NaN) <= value)) lo[k] = value;
    if (!((hi[k] ?? NaN) >= value)) hi[k] = value;
  });
  return { lo, hi };
}

interface InputProps {
  readonly text: Signal<string>;
  /** Names of signals, as an expression has them. */
  readonly names: readonly string[];
  readonly words: ExpressionWords | undefined;
  /** What the server says about a mistake; "" without one. */
  readonly mistake: string;
  readonly onEnter: () => void;
}

/** A field for an expression: completion of signals, functions and units at the caret, and the place of a mistake. */
function ExpressionInput({ text, names, words, mistake, onEnter }: InputProps) {
  const input = useRef<HTMLInputElement>(null);
  const find = useCallback((typed: string, caret: number) => completionsAt(typed, caret, names, words), [names, words]);
  const offer = useCompletion(input, text, find);
  useEffect(() => {
    // also on a phone, where the dialog around it keeps the focus on its heading
    const frame = requestAnimationFrame(() => input.current?.focus());
    return () => cancelAnimationFrame(frame);
  }, []);
  const onKey = (event: KeyboardEvent): void => {
    if (offer.onKey(event) || event.key !== "Enter") return;
    event.preventDefault();
    onEnter();
  };
  const place = mistake === "" ? undefined : mistakePlace(mistake, text.value);
  return (
    <div class="expression">
      <span class="field">
        <input
          ref={input}
          type="text"
          role="combobox"
          aria-label={TEXT.expression}
          aria-expanded={offer.all.value.length > 0}
          {...completed("expression-words", offer)}
          aria-invalid={mistake !== ""}
          aria-describedby="expression-mistake"
          placeholder={TEXT.expressionHint}
          value={text.value}
          spellcheck={false}
          autocomplete="off"
          autocapitalize="off"
          onInput={(event) => {
            text.value = event.currentTarget.value;
            offer.open();
          }}
          onKeyDown={onKey}
          onBlur={offer.close}
        />
      </span>
      {place && (
        <div class="expression-place mid text-sm" aria-hidden="true">
          <MarkedMistake text={text.value} {...place} />
        </div>
      )}
      <CompletionList id="expression-words" offer={offer} />
      <p id="expression-mistake" class="expression-mistake" role="status">
        {mistake}
      </p>
    </div>
  );
}
