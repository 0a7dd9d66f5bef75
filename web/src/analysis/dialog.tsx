/** The analysis dialog: spectrum, Allan deviation or statistics of a signal or an expression, over a range of the view. */
import { type Signal, useComputed, useSignal, useSignalEffect } from "@preact/signals";
import type { Deps } from "../panels/panel-context";
import { Dialog } from "../ui/dialog";
import { type Problem, request } from "../ui/http";
import { ProblemNote } from "../ui/problem-note";
import type { AnalysisRequest, SignalFigures } from "../wire/routes";
import { hasCursors, inertialNames, type Name, type Range, signalNames, signalsIn, timesOf } from "./figures";
import { type Answered, Result } from "./results";
import { TEXT } from "../texts/analysis";
import "./analysis.css";

const NAMES: readonly Name[] = ["psd", "spectrogram", "allan", "statistics"];
const RANGES: readonly Range[] = ["window", "cursors", "everything"];
const LENGTHS = [0, 64, 256, 1024, 4096, 16384, 65536];
const WINDOWS = ["hann", "hamming", "blackmanharris", "flattop", "boxcar"];
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
const COLUMNS = 600;

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

interface Choice {
  readonly name: Signal<Name>;
  readonly text: Signal<string>;
  readonly range: Signal<Range>;
  readonly window: Signal<string>;
  readonly length: Signal<number>;
  readonly scale: Signal<string>;
  readonly xKind: Signal<"linear" | "log">;
  readonly motion: Signal<string>;
}

export function AnalysisDialog({ title, onClose, ...rest }: Props) {
  return (
    <Dialog title={TEXT.analysisOf(title)} wide onClose={onClose}>
      <AnalysisView {...rest} />
    </Dialog>
  );
}

/** The analysis without the dialog around it. */
export function AnalysisView({ deps, source, prefix, isLive }: Omit<Props, "title" | "onClose">) {
  const { viewState, store } = deps;
  const names = useComputed(() => signalNames(store.channels.value, viewState.view.value.device));
  const choice: Choice = {
    name: useSignal<Name>("psd"),
    text: useSignal(names.peek()[0] ?? ""),
    range: useSignal<Range>(hasCursors(viewState) ? "cursors" : "window"),
    window: useSignal("hann"),
    length: useSignal(0),
    scale: useSignal("amplitude"),
    xKind: useSignal<"linear" | "log">("linear"),
    motion: useSignal("exclude"),
  };
  const answered = useSignal<Answered | undefined>(undefined);
  const problem = useSignal<Problem | undefined>(undefined);
  const busy = useSignal(true);
  const wanted = useComputed(() => bodyOf(choice, prefix));
  useSignalEffect(() => {
    const { name, body } = wanted.value;
    const range = choice.range.value;
    const cancel = new AbortController();
    let timer: ReturnType<typeof setTimeout> | undefined;
    const rangeNow = () => ({
      ...timesOf(range, viewState, store.serverNow()),
      base: viewState.view.peek().timeBase,
    });
    let asked = "";
    const look = async (): Promise<void> => {
      const times = rangeNow();
      const grows = isLive && (range === "everything" || (range === "window" && viewState.view.peek().live));
      if (grows || JSON.stringify(times) !== asked) {
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
    <div class="analysis">
      <Controls choice={choice} names={names.value} hasCursors={hasCursors(viewState)} />
      {problem.value && <ProblemNote problem={problem.value} />}
      {answered.value ? (
        <Result xKind={choice.xKind.value} {...answered.value} />
      ) : (
        busy.value && <p>{TEXT.computing}</p>
      )}
    </div>
  );
}

function bodyOf(choice: Choice, prefix: string) {
  const name = choice.name.value;
  const signals = signalsIn(choice.text.value).map((one) => (/^[\p{L}_][\w .]*$/u.test(one) ? prefix + one : one));
  return { name, body: { signals, options: optionsOf(choice) } };
}

function optionsOf({ name, window, length, scale, motion }: Choice): Record<string, string | number> {
  const segments = { window: window.value, length: length.value, scale: scale.value };
  if (name.value === "psd") return segments;
  if (name.value === "spectrogram") return { ...segments, overlap: 0.75, columns: COLUMNS };
  return name.value === "allan" ? { motion: motion.value } : {};
}

interface ControlsProps {
  readonly choice: Choice;
  readonly names: readonly string[];
  readonly hasCursors: boolean;
}

function Controls({ choice, names, hasCursors: cursors }: ControlsProps) {
  const { name, text, range } = choice;
  const choose = (next: Name): void => {
    name.value = next;
    if (next !== "allan") return;
    if (range.value === "window") range.value = "everything";
    if (text.value === names[0]) text.value = inertialNames(names).join(", "); // all axes at once
  };
  return (
    <>
      <div class="analysis-row">
        <div class="segmented" role="group" aria-label={TEXT.kind}>
          {NAMES.map((one) => (
            <button type="button" key={one} aria-pressed={name.value === one} onClick={() => choose(one)}>
              {TEXT[one]}
            </button>
          ))}
        </div>
        <div class="segmented" role="group" aria-label={TEXT.range}>
          {RANGES.filter((one) => one !== "cursors" || cursors).map((one) => (
            <button type="button" key={one} aria-pressed={range.value === one} onClick={() => (range.value = one)}>
              {TEXT.ranges[one]}
            </button>
          ))}
        </div>
      </div>
      <label class="analysis-signal">
        <span>{TEXT.signal}</span>
        <span class="field">
          <input
            type="text"
            list="analysis-signals"
            value={text.value}
            spellcheck={false}
            autocomplete="off"
            onInput={(event) => (text.value = event.currentTarget.value)}
          />
        </span>
        <datalist id="analysis-signals">
          {names.map((one) => (
            <option key={one} value={one} />
          ))}
        </datalist>
        <small class="dim">{TEXT.signalHint}</small>
      </label>
      {(name.value === "psd" || name.value === "spectrogram") && (
        <div class="analysis-row">
          <Select label={TEXT.windowFunction} value={choice.window} values={WINDOWS} />
          <Lengths length={choice.length} />
          <Select label={TEXT.scale} value={choice.scale} values={["amplitude", "power"]} />
          {name.value === "psd" && (
            <Select label={TEXT.frequencyAxis} value={choice.xKind} values={["linear", "log"]} />
          )}
        </div>
      )}
      {name.value === "allan" && (
        <div class="analysis-row">
          <Select label={TEXT.motion} value={choice.motion} values={["exclude", "include"]} />
        </div>
      )}
    </>
  );
}

interface SelectProps<T extends string> {
  readonly label: string;
  readonly value: Signal<T>;
  readonly values: readonly T[];
}

function Select<T extends string>({ label, value, values }: SelectProps<T>) {
  return (
    <label class="analysis-option">
      <span>{label}</span>
      <span class="select">
        <select value={value.value} onChange={(event) => (value.value = event.currentTarget.value as T)}>
          {values.map((one) => (
            <option key={one} value={one}>
              {TEXT.choices[one] ?? one}
            </option>
          ))}
        </select>
      </span>
    </label>
  );
}

function Lengths({ length }: { readonly length: Signal<number> }) {
  return (
    <label class="analysis-option">
      <span>{TEXT.segment}</span>
      <span class="select">
        <select value={String(length.value)} onChange={(event) => (length.value = Number(event.currentTarget.value))}>
          {LENGTHS.map((one) => (
            <option key={one} value={String(one)}>
              {one === 0 ? TEXT.automatic : one}
            </option>
          ))}
        </select>
      </span>
    </label>
  );
}
