/** The analysis dialog: spectrum, Allan deviation or statistics of a signal or an expression, over a range of the view. */
import { type Signal, useComputed, useSignal, useSignalEffect } from "@preact/signals";
import { useId, useMemo } from "preact/hooks";
import type { AnalysisPanel } from "../../data/view";
import type { Deps } from "../../page/context";
import { Segmented, Select } from "../../ui/controls/choices";
import { Dialog } from "../../ui/controls/dialog";
import { type HttpProblem, request } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import type { AnalysisRequest, SignalFigures } from "../../wire/routes";
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
import { type Name, type RangeName, signalNames, signalsIn, timesOf } from "./figures";
import { type Answered, AnalysisResult } from "./results";
import { TEXT } from "./texts";
import "./analysis.css";

const NAMES: readonly Name[] = ["psd", "spectrogram", "allan", "statistics"];
const RANGES: readonly RangeName[] = ["window", "cursors", "everything"];
/** Pause after typing, ms. */
const TYPED_MS = 350;
/** Figures of a range that moves are computed this often, ms, as far as the server keeps up. */
const LIVE_MS = 250;
/** Over a recording the server reads the samples from disk each time. */
const RECORDED_MS = 1000;
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
  readonly title: string;
  /** Put before the names of signals, if a recording has several devices: "2/". */
  readonly prefix: string;
  readonly isLive: boolean;
  readonly onClose: () => void;
}

export function AnalysisDialog({ title, onClose, ...rest }: Props) {
  return (
    <Dialog title={TEXT.analysisOf(title)} wide onClose={onClose}>
      <AnalysisView {...rest} />
    </Dialog>
  );
}

interface ViewProps extends Omit<Props, "title" | "onClose"> {
  /** The only analysis that is shown; what is chosen for it is part of the workspace. Default: all, one at a time. */
  readonly only?: AnalysisPanel;
}

/** The analysis without the dialog around it. */
export function AnalysisView({ deps, source, prefix, isLive, only }: ViewProps) {
  const { viewState, store } = deps;
  const names = useComputed(() => signalNames(store.channels.value, viewState.device.value));
  const canRange = useComputed(() => hasCursors(viewState));
  const plots = useMemo(() => {
    const drawn = deps.samples?.drawn ?? store; // of a recording, what is on screen
    return { view: viewState.view, edge: () => drawn.edgeOf(viewState.device.peek()) };
  }, [deps, store, viewState]);
  const shown = useSignal<Name>(only ?? "psd");
  const state = useChoice(viewState, only);
  // of the dialog: cursors that are set when it is opened are what is looked at
  const between = useSignal(only === undefined && hasCursors(viewState)).peek();
  const choice = useComputed(() => wholeChoice(shown.value, state.choice.value, names.value, between));
  const answered = useSignal<Answered | undefined>(undefined);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const busy = useSignal(true);
  const wanted = useComputed(() => bodyOf(shown.value, choice.value, prefix));
  useSignalEffect(() => {
    const { name, body } = wanted.value;
    const range = choice.value.range;
    if (choice.value.signals === "") return undefined; // no channel yet
    const cancel = new AbortController();
    let timer: ReturnType<typeof setTimeout> | undefined;
    const rangeNow = () => ({
      ...timesOf(range, viewState, store.edgeOf(viewState.device.peek())),
      base: viewState.view.peek().timeBase,
    });
    let asked = "";
    const look = async (): Promise<void> => {
      const times = rangeNow();
      const grows = isLive && (range === "everything" || (range === "window" && viewState.view.peek().live));
      const isSeen = document.visibilityState !== "hidden";
      if (isSeen && (grows || JSON.stringify(times) !== asked)) {
        asked = JSON.stringify(times);
        await ask({ ...body, ...times, source });
      }
      const pause =
        range === "everything" ? SLOW_MS : name === "spectrogram" ? HEAVY_MS : isLive ? LIVE_MS : RECORDED_MS;
      if (!cancel.signal.aborted) timer = setTimeout(() => void look(), pause);
    };
    const ask = async (whole: AnalysisRequest): Promise<void> => {
      const outcome = await request("POST /api/analysis/{name}", {
        path: { name },
        body: whole,
        signal: cancel.signal,
      });
      if (cancel.signal.aborted) return;
      busy.value = false;
      problem.value = outcome.ok ? undefined : outcome.problem;
      if (outcome.ok) answered.value = { name, figures: outcome.value as readonly SignalFigures[], body: whole };
    };
    busy.value = true;
    timer = setTimeout(() => void look(), answered.peek() === undefined ? 0 : TYPED_MS);
    return () => {
      clearTimeout(timer);
      cancel.abort();
    };
  });
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
      {problem.value && <ProblemNote problem={problem.value} />}
      {answered.value ? (
        <AnalysisResult
          xKind={choice.value.frequencyAxis}
          plots={only !== undefined && choice.value.range === "window" ? plots : undefined}
          {...answered.value}
        />
      ) : (
        busy.value && <p>{TEXT.computing}</p>
      )}
    </div>
  );
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
      <span class={isOnly ? "visually-hidden" : ""}>{TEXT.signal}</span>
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
      {!isOnly && <small class="dim">{TEXT.signalHint}</small>}
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
  // a panel is low: its chart comes before what is seldom changed
  if (isOnly)
    return (
      <>
        <div class="analysis-row">
          {range}
          {signals}
        </div>
        <details class="analysis-more">
          <summary>{TEXT.options}</summary>
          {options}
        </details>
      </>
    );
  return (
    <>
      <div class="analysis-row">
        <Segmented
          label={TEXT.kind}
          value={name}
          options={NAMES.map((one) => [one, TEXT[one]])}
          onChoose={(one) => (shown.value = one)}
        />
        {range}
      </div>
      {signals}
      {options}
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
