/** What an analysis is asked for, and its figures as the dialog shows them. */
import { colourOf, curveName } from "../../charts/curve-colours";
import type { Channel } from "../../data/channels";
import type { ViewState } from "../../data/view-state";
import type { AnalysisRequest, SignalFigures } from "../../wire/routes";
import { figure } from "../../charts/axes";
import { isOfQuaternion } from "../../signals/names";
import type { ChartCurve, CurveNumbers } from "./chart";

export type Name = "statistics" | "psd" | "spectrogram" | "allan";
export type RangeName = "window" | "cursors" | "everything";

/**
 * The times of a range, unix s; null is the beginning or the end.
 *
 * @param edge right edge of a window that is live: now, or the end of a source that ended
 */
export function timesOf(
  range: RangeName,
  { view, cursor, measure }: Pick<ViewState, "view" | "cursor" | "measure">,
  edge: number,
): Pick<AnalysisRequest, "t0" | "t1"> {
  if (range === "everything") return { t0: null, t1: null };
  const [pinned, second] = [cursor.peek(), measure.peek()];
  if (range === "cursors" && pinned?.kind === "pinned" && second !== undefined) {
    const ends = [pinned.time, second];
    return { t0: Math.min(...ends), t1: Math.max(...ends) };
  }
  const { live, end, span } = view.peek();
  const last = live ? edge : end;
  return { t0: last - span, t1: last };
}

/** Those times as a part of the question: a window that moves with the data stays the same one. */
export function rangeQuestion(
  range: RangeName,
  { view, isLive, span, timeBase, cursor, measure }: ViewState,
  isPlaying: boolean,
): string {
  if (range === "everything") return timeBase.value;
  const pinned = range === "cursors" ? cursor.value : undefined;
  if (pinned?.kind === "pinned" && measure.value !== undefined)
    return `${pinned.time} ${measure.value} ${timeBase.value}`;
  if (isLive.value || isPlaying) return `last ${span.value} ${timeBase.value}`;
  const { end } = view.peek();
  void view.value; // every frame of a drag is another question
  return `${end} ${span.value} ${timeBase.value}`;
}

const NUMBERS: readonly Channel["info"]["kind"][] = ["vector", "quaternion", "euler", "scalar", "record", "matrix"];
const FIRST = /^acceleration$|acc/i;

/** Names of the channels that the server can analyse, the most wanted one first. */
export function signalNames(channels: readonly Channel[], device: string | undefined): readonly string[] {
  const names = channels
    .filter(({ info }) => info.device === device && NUMBERS.includes(info.kind))
    .filter((one) => one.info.source !== "page" || isOfQuaternion(one, channels))
    .map(({ info }) => info.name);
  const all = [...new Set(names)];
  const first = all.find((name) => /^acceleration$/i.test(name)) ?? all.find((name) => FIRST.test(name));
  return first === undefined ? all : [first, ...all.filter((name) => name !== first)];
}

/** The accelerometers and the gyroscopes among the names; the first name if there are none. */
export function inertialNames(names: readonly string[]): readonly string[] {
  const found = [/^acceleration$/i, /^rate.?of.?turn$|^angular.?(rate|velocity)$/i].flatMap(
    (words) => names.find((name) => words.test(name)) ?? [],
  );
  return found.length > 0 ? found : names.slice(0, 1);
}

/** The signals of a list with commas; a comma within parentheses or quotation marks belongs to its signal. */
export function signalsIn(text: string): readonly string[] {
  const found: string[] = [];
  let [depth, isQuoted, begin] = [0, false, 0];
  for (let at = 0; at <= text.length; at += 1) {
    const sign = text[at];
    if (sign === '"') isQuoted = !isQuoted;
    if (!isQuoted && sign === "(") depth += 1;
    if (!isQuoted && sign === ")") depth -= 1;
    if (sign !== undefined && (sign !== "," || isQuoted || depth > 0)) continue;
    found.push(text.slice(begin, at).trim());
    begin = at + 1;
  }
  const named = found.filter((one) => one !== "");
  return named.length > 0 ? named : [text.trim()];
}

/** Signals whose figure has the same unit share a chart. */
export function signalsByUnit(answers: readonly SignalFigures[], name: string): readonly (readonly SignalFigures[])[] {
  const units = new Map<string, SignalFigures[]>();
  for (const one of answers) units.set(one.units[name] ?? "", [...(units.get(one.units[name] ?? "") ?? []), one]);
  return [...units.values()];
}

const list = (figures: SignalFigures["figures"], name: string): CurveNumbers => {
  const value = figures[name];
  return Array.isArray(value) ? (value as CurveNumbers) : [];
};

/** Curves of a spectrum or an Allan deviation. 0 Hz has no place on a logarithmic axis and holds only what is left of the trend. */
export function curvesOf(name: Name, answers: readonly SignalFigures[]): readonly ChartCurve[] {
  return answers.map(({ signal, figures }, at) => {
    const shown = { name: curveName(signal), colour: colourOf(signal, at) };
    if (name === "psd") {
      const [x, y, low, high] = ["frequency", "psd", "low", "high"].map((key) => list(figures, key).slice(1));
      return { ...shown, x: x ?? [], y: y ?? [], low: low ?? [], high: high ?? [] };
    }
    return {
      ...shown,
      x: list(figures, "tau"),
      y: list(figures, "adev"),
      low: list(figures, "low"),
      high: list(figures, "high"),
      model: list(figures, "model"),
      ...(at === 0 && figures["data_sheet"] !== undefined ? { reference: list(figures, "data_sheet") } : {}),
    };
  });
}

export interface Peak {
  readonly frequency: number;
  readonly uncertainty: number;
  readonly rms: number;
  readonly above_floor: number;
  readonly order: number;
  readonly harmonic_of: number | null;
}

export interface Parameter {
  readonly value: number;
  readonly low: number;
  readonly high: number;
}

export function peaksOf({ figures }: SignalFigures): readonly Peak[] {
  return (figures["peaks"] as readonly Peak[] | undefined) ?? [];
}

export function parametersOf({ figures }: SignalFigures): Readonly<Record<string, Parameter>> {
  return (figures["parameters"] as Readonly<Record<string, Parameter>> | undefined) ?? {};
}

/** Whether a figure of the data sheet is met, exceeded, or not decided. */
export interface Verdict {
  readonly parameter: string;
  readonly state: "met" | "above" | "open";
  readonly words: string;
}

export function verdictsOf({ figures }: SignalFigures): readonly Verdict[] {
  return (figures["verdicts"] as readonly Verdict[] | undefined) ?? [];
}

/** What prevents a verdict on a signal. */
interface Obstacle {
  readonly message: string;
  readonly hint: string;
}

const obstaclesIn = ({ figures }: SignalFigures): readonly Obstacle[] =>
  (figures["obstacles"] as readonly Obstacle[] | undefined) ?? [];

/** Sentences on what prevents a verdict, with what to do; those that do not hold for all signals begin with their names. */
export function obstaclesOf(answers: readonly SignalFigures[]): readonly string[] {
  return shared(answers, (one) => obstaclesIn(one).map(({ message, hint }) => `${message} ${hint}`));
}

/** The notes of all signals; one that does not hold for each of them begins with their names. */
export function notesOf(answers: readonly SignalFigures[]): readonly string[] {
  return shared(answers, ({ figures }) => {
    const unchecked = figures["unchecked"] as string | undefined;
    return [...((figures["notes"] as readonly string[] | undefined) ?? []), ...(unchecked ? [unchecked] : [])];
  });
}

function shared(
  answers: readonly SignalFigures[],
  sentences: (of: SignalFigures) => readonly string[],
): readonly string[] {
  const holders = new Map<string, string[]>();
  for (const one of answers)
    for (const note of sentences(one)) holders.set(note, [...(holders.get(note) ?? []), curveName(one.signal)]);
  return [...holders].map(([note, names]) => (names.length === answers.length ? note : `${names.join(", ")}: ${note}`));
}

/** Both ends of an interval, rounded outwards to the third digit of the larger, so that what lies between still does. */
export function ends(low: number, high: number): readonly [string, string] {
  const digit = 10 ** (Math.floor(Math.log10(Math.max(Math.abs(low), Math.abs(high), 1e-300))) - 2);
  // 1e-9: 0.00034 / 1e-6 is a little more than 340
  return [figure(Math.floor(low / digit + 1e-9) * digit), figure(Math.ceil(high / digit - 1e-9) * digit)];
}

/** The figures as CSV: a column of x, then one per signal; of statistics a line per figure. */
export function analysisCsv(name: Name, answers: readonly SignalFigures[]): string {
  const quoted = (text: string): string => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const head = answers.map(({ signal }) => quoted(signal));
  const first = answers[0];
  if (!first) return "";
  const lines: string[] = [];
  if (name === "statistics") {
    lines.push(["figure", "unit", ...head].join(","));
    for (const key of Object.keys(first.figures))
      if (key !== "notes")
        lines.push(
          [key, first.units[key] ?? "", ...answers.map(({ figures }) => String(figures[key] ?? ""))].join(","),
        );
  } else {
    const [x, y] = name === "psd" ? (["frequency", "psd"] as const) : (["tau", "adev"] as const);
    const unit = (key: string): string => (first.units[key] === undefined ? "" : ` (${first.units[key]})`);
    lines.push([`${x}${unit(x)}`, ...answers.map(({ signal }) => quoted(`${signal}${unit(y)}`))].join(","));
    list(first.figures, x).forEach((value, i) => {
      lines.push([value, ...answers.map(({ figures }) => list(figures, y)[i] ?? "")].join(","));
    });
  }
  return `${lines.join("\n")}\n`;
}
