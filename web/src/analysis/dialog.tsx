/** The analysis dialog: spectrum, Allan deviation or statistics of a signal or an expression, over a range of the view. */
import { type Signal, useComputed, useSignal, useSignalEffect } from "@preact/signals";
import type { Deps } from "../panels/panel-context";
import { copyText } from "../ui/copy";
import { Dialog } from "../ui/dialog";
import { type Problem, request } from "../ui/http";
import { Message } from "../ui/message";
import { ProblemNote } from "../ui/problem-note";
import type { SignalFigures } from "../wire/routes";
import { figure } from "./axes";
import { Chart } from "./chart";
import {
  csvOf,
  curvesOf,
  hasCursors,
  type Name,
  notesOf,
  parametersOf,
  peaksOf,
  type Range,
  shortName,
  signalNames,
  timesOf,
} from "./figures";
import { TEXT } from "../texts/analysis";
import "./analysis.css";

const NAMES: readonly Name[] = ["psd", "allan", "statistics"];
const RANGES: readonly Range[] = ["window", "cursors", "everything"];
const LENGTHS = [0, 64, 256, 1024, 4096, 16384, 65536];
const WINDOWS = ["hann", "hamming", "blackmanharris", "flattop", "boxcar"];
/** Pause after typing, ms. */
const TYPED_MS = 350;
/** Live figures are computed this often, ms, as far as the server keeps up. */
const LIVE_MS = 250;
/** Those of everything in memory change slowly. */
const SLOW_MS = 2000;
const MAX_MARKS = 6;

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

interface Answered {
  readonly name: Name;
  readonly figures: readonly SignalFigures[];
}

export function AnalysisDialog({ deps, source, title, prefix, isLive, onClose }: Props) {
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
    const ask = async (): Promise<void> => {
      const times = timesOf(range, viewState, store.serverNow());
      const base = viewState.view.peek().timeBase;
      const input = { path: { name }, body: { ...body, ...times, source, base }, signal: cancel.signal };
      const outcome = await request("POST /api/analysis/{name}", input);
      if (cancel.signal.aborted) return;
      busy.value = false;
      problem.value = outcome.ok ? undefined : outcome.problem;
      if (outcome.ok) answered.value = { name, figures: outcome.value as readonly SignalFigures[] };
      const moves = range === "everything" || (range === "window" && viewState.view.peek().live);
      if (isLive && moves) timer = setTimeout(() => void ask(), range === "everything" ? SLOW_MS : LIVE_MS);
    };
    busy.value = true;
    timer = setTimeout(() => void ask(), answered.peek() === undefined ? 0 : TYPED_MS);
    return () => {
      clearTimeout(timer);
      cancel.abort();
    };
  });
  return (
    <Dialog title={TEXT.analysisOf(title)} wide onClose={onClose}>
      <div class="analysis">
        <Controls choice={choice} names={names.value} hasCursors={hasCursors(viewState)} />
        {problem.value && <ProblemNote problem={problem.value} />}
        {answered.value ? <Result choice={choice} {...answered.value} /> : busy.value && <p>{TEXT.computing}</p>}
      </div>
    </Dialog>
  );
}

function bodyOf(choice: Choice, prefix: string) {
  const text = choice.text.value.trim();
  const isName = /^[\p{L}_][\w .]*$/u.test(text);
  const name = choice.name.value;
  const options =
    name === "psd"
      ? { window: choice.window.value, length: choice.length.value, scale: choice.scale.value }
      : name === "allan"
        ? { motion: choice.motion.value }
        : {};
  return { name, body: { signals: [isName ? prefix + text : text], options } };
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
    if (next === "allan" && range.value === "window") range.value = "everything";
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
      {name.value === "psd" && (
        <div class="analysis-row">
          <Select label={TEXT.windowFunction} value={choice.window} values={WINDOWS} />
          <Lengths length={choice.length} />
          <Select label={TEXT.scale} value={choice.scale} values={["amplitude", "power"]} />
          <Select label={TEXT.frequencyAxis} value={choice.xKind} values={["linear", "log"]} />
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

function Result({ choice, name, figures }: { readonly choice: Choice } & Answered) {
  const first = figures[0];
  if (!first) return null;
  const signals = figures.map(({ signal }) => signal).join(", ");
  const notes = notesOf(figures);
  return (
    <>
      {name === "psd" && (
        <>
          <Chart
            label={TEXT.chart(TEXT.psd, signals)}
            curves={curvesOf(name, figures)}
            xKind={choice.xKind.value}
            xTitle={TEXT.frequency}
            xUnit="Hz"
            yTitle={TEXT.density}
            yUnit={first.units["psd"] ?? ""}
            marks={figures
              .flatMap((one) => peaksOf(one))
              .slice(0, MAX_MARKS)
              .map((peak) => ({ x: peak.frequency, text: figure(peak.frequency) }))}
          />
          <p class="dim">
            {TEXT.basedOn(
              Number(first.figures["segments"]),
              Number(first.figures["length"]),
              figure(first.figures["rate"] as number),
            )}
            . {TEXT.band}
          </p>
          <Peaks figures={figures} />
        </>
      )}
      {name === "allan" && (
        <>
          <Chart
            label={TEXT.chart(TEXT.allan, signals)}
            curves={curvesOf(name, figures)}
            xKind="log"
            xTitle={TEXT.averagingTime}
            xUnit="s"
            yTitle={TEXT.deviation}
            yUnit={first.units["adev"] ?? ""}
          />
          <p class="dim">
            {TEXT.basedOnSamples(Number(first.figures["n"]), figure(first.figures["rate"] as number))}. {TEXT.band}{" "}
            {TEXT.model}
          </p>
          <Parameters figures={figures} />
        </>
      )}
      {name === "statistics" && <Statistics figures={figures} />}
      {notes.length > 0 && (
        <ul class="analysis-notes">
          {notes.map((note) => (
            <li key={note}>
              <Message text={note} />
            </li>
          ))}
        </ul>
      )}
      <Copy name={name} figures={figures} />
    </>
  );
}

type Figures = Pick<Answered, "figures">;

function Peaks({ figures }: Figures) {
  const rows = figures.flatMap((one) => peaksOf(one).map((peak) => ({ peak, signal: one.signal, unit: one.units })));
  if (rows.length === 0) return <p>{TEXT.noPeaks}</p>;
  return (
    <Scroll label={TEXT.peaks}>
      <thead>
        <tr>
          <th />
          <th>{TEXT.frequency}</th>
          <th>{TEXT.rms}</th>
          <th>{TEXT.aboveFloor}</th>
          <th>{TEXT.fundamental}</th>
        </tr>
      </thead>
      <tbody>
        {rows.map(({ peak, signal, unit }) => (
          <tr key={`${signal} ${peak.frequency}`}>
            <th scope="row">{shortName(signal)}</th>
            <td>
              {figure(peak.frequency, 6)} ± {figure(peak.uncertainty, 2)} Hz
            </td>
            <td>
              {figure(peak.rms)} {unit["peaks.rms"] ?? ""}
            </td>
            <td>{TEXT.decibels(figure(peak.above_floor, 3))}</td>
            <td>{peak.harmonic_of === null ? "1" : TEXT.ofHarmonic(peak.order, figure(peak.harmonic_of))}</td>
          </tr>
        ))}
      </tbody>
    </Scroll>
  );
}

function Parameters({ figures }: Figures) {
  return (
    <BySignal
      label={TEXT.parameters}
      figures={figures}
      rows={Object.keys(figures[0] ? parametersOf(figures[0]) : {})}
      title={(name) => TEXT.parameter[name] ?? name}
      cell={(one, name) => {
        const { value, low, high } = parametersOf(one)[name] ?? { value: 0, low: 0, high: 0 };
        const unit = one.units[`parameters.${name}.value`] ?? "";
        if (value <= 0) return TEXT.atMost(`${figure(high, 2)} ${unit}`);
        return (
          <>
            {figure(value)} {unit}
            <small class="dim" title={TEXT.interval}>
              {" "}
              {figure(low, 2)} … {figure(high, 2)}
            </small>
          </>
        );
      }}
    />
  );
}

function Statistics({ figures }: Figures) {
  return (
    <BySignal
      label={TEXT.statistics}
      figures={figures}
      rows={Object.keys(figures[0]?.figures ?? {}).filter((name) => name !== "notes")}
      title={(name) => TEXT.statistic[name] ?? name}
      cell={({ figures: of, units }, name) =>
        `${figure(of[name] as number | null, name === "n" ? 9 : 5)} ${units[name] ?? ""}`
      }
    />
  );
}

interface BySignalProps extends Figures {
  readonly label: string;
  readonly rows: readonly string[];
  readonly title: (row: string) => string;
  readonly cell: (of: SignalFigures, row: string) => preact.ComponentChildren;
}

/** A table with a column for each signal. */
function BySignal({ label, figures, rows, title, cell }: BySignalProps) {
  return (
    <Scroll label={label}>
      <thead>
        <tr>
          <th />
          {figures.map(({ signal }) => (
            <th key={signal}>{shortName(signal)}</th>
          ))}
        </tr>
      </thead>
      <tbody>
        {rows.map((row) => (
          <tr key={row}>
            <th scope="row">{title(row)}</th>
            {figures.map((one) => (
              <td key={one.signal}>{cell(one, row)}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </Scroll>
  );
}

function Scroll({ label, children }: { readonly label: string; readonly children: preact.ComponentChildren }) {
  return (
    <div class="analysis-table" role="region" aria-label={label} tabIndex={0}>
      <table>{children}</table>
    </div>
  );
}

function Copy({ name, figures }: Answered) {
  const said = useSignal("");
  const copy = async (): Promise<void> => {
    said.value = (await copyText(csvOf(name, figures))) ? TEXT.copied : TEXT.notCopied;
  };
  return (
    <p class="analysis-row">
      <button type="button" class="btn edge" onClick={() => void copy()}>
        {TEXT.copy}
      </button>
      <span role="status">{said.value}</span>
    </p>
  );
}
