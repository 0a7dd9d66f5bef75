/** An analysis: spectrum, Allan deviation or statistics of a signal or an expression, over a range of the view. */
import { type Signal, useComputed, useSignal } from "@preact/signals";
import { useEffect, useId, useMemo, useRef } from "preact/hooks";
import type { AnalysisPanel } from "../../data/view";
import type { Deps } from "../../page/context";
import { Segmented, Select } from "../../ui/controls/choices";
import { IconButton } from "../../ui/controls/icon-button";
import { type Outcome, request } from "../../requests/http";
import { Answered, useAnswer } from "../../requests/use-answer";
import type { SignalFigures } from "../../wire/routes";
import {
  type ChoiceChange,
  type ChoiceState,
  LENGTHS,
  useChoice,
  type WholeChoice,
  wholeChoice,
  WINDOWS,
} from "./choice";
import { hasCursors } from "../../data/view-state";
import { clock } from "../../ui/format/format";
import { type Name, type RangeName, rangeQuestion, signalNames, signalsIn, timesOf } from "./figures";
import { likeNames, Proposals } from "./proposals";
import { AnalysisResult, type Result } from "./results";
import { TEXT } from "./texts";
import "./analysis.css";

const NAMES: readonly Name[] = ["psd", "spectrogram", "allan", "statistics"];
const RANGES: readonly RangeName[] = ["window", "cursors", "everything"];
/** Pause after typing, ms. */
const TYPED_MS = 350;
/** Figures of a range that moves are computed this often, ms, as far as the server keeps up. */
const LIVE_MS = 250;
/** Over a recording that plays. */
const RECORDED_MS = 250;
/** A range that is dragged is another question this often, ms. */
const DRAGGED_MS = 100;
/** Pictures have a hundred times as many figures. */
const HEAVY_MS = 1000;
/** Those of everything in memory change slowly. */
const SLOW_MS = 2000;
/** More columns than pixels show nothing more. */
const PLOT_COLUMNS = 600;

interface Props {
  readonly deps: Deps;
  /** Id of the live device, or of the recording. */
  readonly source: string;
  /** Of the device. */
  readonly title: string;
  /** Put before the names of signals, if a recording has several devices: "2/". */
  readonly prefix: string;
  readonly isLive: boolean;
  /** The only analysis that is shown; what is chosen for it is part of the workspace. Default: all, one at a time. */
  readonly only?: AnalysisPanel;
}

/** A value that changes at most once in so many milliseconds. */
function useSpaced<T>(value: T, ms: number): T {
  const spaced = useSignal(value);
  const last = useRef(-Infinity);
  useEffect(() => {
    const take = (): void => {
      last.current = performance.now();
      spaced.value = value;
    };
    const timer = setTimeout(take, Math.max(0, last.current + ms - performance.now()));
    return () => clearTimeout(timer);
  }, [value, ms, spaced]);
  return spaced.value;
}

export function AnalysisView({ deps, source, title, prefix, isLive, only }: Props) {
  const { viewState, store } = deps;
  const names = useComputed(() => signalNames(store.channels.value, viewState.device.value));
  const canRange = useComputed(() => hasCursors(viewState));
  const plots = useMemo(() => {
    const drawn = deps.samples?.drawn ?? store; // of a recording, what is on screen
    return { view: viewState.view, edge: () => drawn.edgeOf(viewState.device.peek()) };
  }, [deps, store, viewState]);
  const shown = useSignal<Name>(only ?? "psd");
  const state = useChoice(viewState, only);
  const choice = useComputed(() => wholeChoice(shown.value, state.choice.value, names.value, hasCursors(viewState)));
  const isPlaying = (): boolean => (deps.recording?.rate() ?? 0) > 0;
  const asked = useComputed(() => rangeQuestion(choice.value.range, viewState, isPlaying())).value;
  const { range } = choice.value;
  const { name, body } = bodyOf(shown.value, choice.value, prefix);
  const grows = range === "everything" ? isLive : asked.startsWith("last");
  const hasNone = choice.value.signals === ""; // no channel yet
  const latest = hasNone ? "" : JSON.stringify([name, body, asked, source]);
  const ask = async (signal: AbortSignal): Promise<Outcome<Result> | undefined> => {
    if (question !== latest) return undefined; // it would be the answer to the next question
    if (grows && document.visibilityState === "hidden") return undefined;
    const times = timesOf(range, viewState, plots.edge());
    const whole = { ...body, ...times, base: viewState.view.peek().timeBase, source };
    const outcome = await request("POST /api/analysis/{name}", { path: { name }, body: whole, signal });
    if (!outcome.ok) return outcome;
    return { ok: true, value: { name, figures: outcome.value as readonly SignalFigures[], body: whole } };
  };
  const pauseMs = range === "everything" ? SLOW_MS : name === "spectrogram" ? HEAVY_MS : isLive ? LIVE_MS : RECORDED_MS;
  const typed = useRef(choice.value.signals);
  const isTyped = typed.current !== choice.value.signals;
  typed.current = choice.value.signals;
  const question = useSpaced(latest, isTyped ? TYPED_MS : DRAGGED_MS);
  const answered = useAnswer(question, ask, { everyMs: grows ? pauseMs : undefined });
  const pinned = useSignal<Result | undefined>(undefined);
  const xKind = choice.value.frequencyAxis;
  const axis = only !== undefined && range === "window" ? plots : undefined;
  const result = useMemo(
    () => answered.answer && <AnalysisResult xKind={xKind} plots={axis} pinned={pinned.value} {...answered.answer} />,
    [answered.answer, xKind, axis, pinned.value],
  );
  const device = viewState.device.value;
  const signals = choice.value.signals;
  return (
    <div class="analysis stacked">
      <Controls
        shown={shown}
        isOnly={only !== undefined}
        choice={choice.value}
        set={state.set}
        names={names.value}
        hasCursors={canRange.value}
      />
      <Answered
        of={answered}
        waiting={!hasNone && <p>{TEXT.computing}</p>}
        instead={({ kind }) =>
          kind === "not-found" && (
            <Proposals
              names={likeNames(signalsIn(signals), device, store.channels.value)}
              choose={(chosen) => state.set({ signals: chosen })}
            />
          )
        }
      >
        {(answer) => (
          <>
            <p class="analysis-question dim text-sm">
              {questionWords(answer, title, prefix)}
              {answer.name !== "spectrogram" && (
                <IconButton icon="flag" label={TEXT.pin} title={TEXT.pinHint} onClick={() => (pinned.value = answer)} />
              )}
            </p>
            {pinned.value && (
              <p class="analysis-question text-sm">
                <span class="line-sample" />
                {TEXT.pinned(questionWords(pinned.value, title, prefix))}
                <IconButton icon="close" label={TEXT.unpin} onClick={() => (pinned.value = undefined)} />
              </p>
            )}
            {result}
          </>
        )}
      </Answered>
    </div>
  );
}

/** What a result is of: signals, device, range. */
function questionWords({ body: { signals, t0, t1 } }: Result, device: string, prefix: string): string {
  const range =
    t0 === null || t1 === null || t0 === undefined || t1 === undefined
      ? TEXT.ranges.everything
      : TEXT.fromTo(clock(t0, 1), clock(t1, 1));
  const names = signals.map((one) => (one.startsWith(prefix) ? one.slice(prefix.length) : one));
  return [names.join(", "), device, range].join(" · ");
}

function bodyOf(name: Name, choice: WholeChoice, prefix: string) {
  const signals = signalsIn(choice.signals).map((one) => (/^[\p{L}_][\w .]*$/u.test(one) ? prefix + one : one));
  return { name, body: { signals, options: optionsOf(name, choice) } };
}

function optionsOf(
  name: Name,
  { window, length, scale, motion, temperature }: WholeChoice,
): Record<string, string | number> {
  if (name === "psd") return { window, length, scale };
  if (name === "spectrogram") return { window, length, scale, overlap: 0.75, columns: PLOT_COLUMNS };
  return name === "allan" ? { motion, temperature } : {};
}

interface ControlsProps extends Pick<ChoiceState, "set"> {
  readonly shown: Signal<Name>;
  /** No other analysis can be chosen. */
  readonly isOnly: boolean;
  readonly choice: WholeChoice;
  readonly names: readonly string[];
  readonly hasCursors: boolean;
}

function Controls({ shown, isOnly, choice, set, names, hasCursors: cursors }: ControlsProps) {
  const name = shown.value;
  const list = useId();
  const option = <K extends "window" | "scale" | "frequencyAxis" | "motion" | "temperature">(
    key: K,
    label: string,
    values: readonly WholeChoice[K][],
  ) => (
    <Choice label={label} value={choice[key]} values={values} set={(value) => set({ [key]: value } as ChoiceChange)} />
  );
  const range = (
    <Segmented
      label={TEXT.range}
      value={choice.range}
      options={RANGES.filter((one) => one !== "cursors" || cursors).map((one) => [one, TEXT.ranges[one]])}
      onChoose={(one) => set({ range: one })}
    />
  );
  const signals = (
    <label class="labelled analysis-signal">
      <span class="visually-hidden">{TEXT.signal}</span>
      <span class="field">
        <input
          type="text"
          list={list}
          title={TEXT.signalHint}
          value={choice.signals}
          spellcheck={false}
          autocomplete="off"
          onInput={(event) => set({ signals: event.currentTarget.value })}
        />
      </span>
      <datalist id={list}>
        {names.map((one) => (
          <option key={one} value={one} />
        ))}
      </datalist>
    </label>
  );
  const options = name !== "statistics" && (
    <div class="analysis-row">
      {name === "allan" ? (
        <>
          {option("motion", TEXT.motion, ["exclude", "include"])}
          {option("temperature", TEXT.temperature, ["exclude", "include"])}
        </>
      ) : (
        <>
          {option("window", TEXT.windowFunction, WINDOWS)}
          <Choice label={TEXT.segment} value={choice.length} values={LENGTHS} set={(length) => set({ length })} />
          {option("scale", TEXT.scale, ["amplitude", "power"])}
          {name === "psd" && option("frequencyAxis", TEXT.frequencyAxis, ["linear", "log"])}
        </>
      )}
    </div>
  );
  return (
    <>
      {!isOnly && (
        <Segmented
          label={TEXT.kind}
          value={name}
          options={NAMES.map((one) => [one, TEXT[one]])}
          onChoose={(one) => (shown.value = one)}
        />
      )}
      <div class="analysis-row">
        {range}
        {signals}
      </div>
      {options && (
        <details class="analysis-more">
          <summary>{TEXT.options}</summary>
          {options}
        </details>
      )}
    </>
  );
}

interface ChoiceProps<T extends string | number> {
  readonly label: string;
  readonly value: T;
  readonly values: readonly T[];
  readonly set: (value: T) => void;
}

function Choice<T extends string | number>({ label, value, values, set }: ChoiceProps<T>) {
  return (
    <label class="labelled">
      <span>{label}</span>
      <Select
        value={value}
        options={values.map((one) => [one, TEXT.choices[String(one)] ?? (one === 0 ? TEXT.automatic : String(one))])}
        onChoose={set}
      />
    </label>
  );
}
