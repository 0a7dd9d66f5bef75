/**
 * Alarms on the plots: a bar along the top of a plot for every interval in which an alarm of one of its signals was raised, and the limit
 * as a dashed line. The intervals come from the server, which judges every sample, so a bar is there however few samples are drawn, and
 * it is never narrower than MIN_PX. Bars of alarms that no plot has a signal of, such as silence, are on the first plot.
 */
import { alarmList } from "./list";
import { type RaisedSpan, raisedSpans } from "./states";
import type { Store } from "../../data/store";
import type { ViewState } from "../../data/view-state";
import type { AlarmInfo } from "../../wire/routes";
import type { EventInfo } from "../../wire/types";
import { fitting, type Palette, setFont } from "../../plots/canvas-style";
import type { PlotSpec } from "../../data/view";
import type { MarkedPlot, PlotMarks } from "../../plots/plot-additions";
import { xOf, type TimeWindow } from "../../plots/time-window";

/** An interval is never narrower, px. */
const MIN_PX = 4;
/** Height of a bar, and distance of two rows, px. */
const BAR_PX = 4;
const ROW_PX = 6;
/** Rows of one plot; further alarms share the last one. */
const MAX_ROWS = 4;
const NAME_PX = 160;

/** The limit of an alarm, in the unit of its signal. */
export interface AlarmLimit {
  readonly name: string;
  readonly subject: string;
  readonly limit: number;
  readonly isError: boolean;
}

export interface AlarmMarks {
  readonly spans: readonly RaisedSpan[];
  readonly limits: readonly AlarmLimit[];
}

/** What is drawn for a device. @param alarms those of the server; none over a recording, whose limits come from its events */
export function alarmMarks(
  events: readonly EventInfo[],
  alarms: readonly AlarmInfo[],
  device: string | undefined,
): AlarmMarks {
  const spans = device === undefined ? [] : raisedSpans(events, device);
  const found = new Map<string, AlarmLimit>();
  for (const { alarm, name, subject, limit, level } of spans)
    if (limit !== undefined) found.set(alarm, { name, subject, limit, isError: level === "error" });
  for (const { id, definition, states } of alarms) {
    found.delete(id); // as it is now, not as it was
    const state = states.find((one) => one.device === device);
    if (state && state.limit !== null) {
      const { subject, limit } = state;
      found.set(id, { name: definition.name, subject, limit, isError: definition.level === "error" });
    }
  }
  return { spans: [...spans, ...unreported(spans, alarms, device)], limits: [...found.values()] };
}

/** Intervals of the present states that no event tells of: one that began before the server was started again. */
function unreported(
  spans: readonly RaisedSpan[],
  alarms: readonly AlarmInfo[],
  device: string | undefined,
): readonly RaisedSpan[] {
  return alarms.flatMap(({ id, definition, states }) =>
    states
      .filter((state) => state.device === device)
      .flatMap(({ intervals, signals, subject, limit }) =>
        intervals.map(({ t0, t1 }) => ({
          alarm: id,
          name: definition.name,
          level: definition.level ?? "warning",
          signals,
          subject,
          limit: limit ?? undefined,
          t0,
          t1: t1 ?? undefined,
        })),
      )
      .filter(({ t0, t1 = Infinity }) =>
        spans.every((one) => one.alarm !== id || one.t0 > t1 || (one.t1 ?? Infinity) < t0),
      ),
  );
}

/** The names by which conditions name what a plot shows: its channels, their columns, and the norm of a vector. */
export function subjectsOf(spec: PlotSpec, hidden: ReadonlySet<string> = new Set()): ReadonlySet<string> {
  const shown = spec.series.filter(({ key }) => !hidden.has(key));
  const names = shown.flatMap(({ channel: { info }, column, norm }) => {
    const name = info.columns[column]?.name;
    return norm ? [`norm(${info.name})`] : [info.name, ...(name === undefined ? [] : [`${info.name}.${name}`])];
  });
  return new Set(names);
}

/** The intervals of each plot, in order of the plots. */
export function spansByPlot(
  spans: readonly RaisedSpan[],
  plots: readonly ReadonlySet<string>[],
): readonly (readonly RaisedSpan[])[] {
  const homeless = spans.filter(({ signals }) => !plots.some((names) => signals.some((one) => names.has(one))));
  return plots.map((names, k) => [
    ...(k === 0 ? homeless : []),
    ...spans.filter(({ signals }) => signals.some((one) => names.has(one))),
  ]);
}

/** The marks of the device in view; recomputed when its events or alarms have changed. */
function alarmsOn(store: Store, { view }: ViewState): () => AlarmMarks {
  const alarms = alarmList(store);
  let before: readonly unknown[] = [];
  let found: AlarmMarks = { spans: [], limits: [] };
  return () => {
    const now = [store.events.peek(), alarms.peek(), view.peek().device];
    if (now.some((one, k) => one !== before[k]))
      found = alarmMarks(store.events.peek(), alarms.peek(), view.peek().device);
    before = now;
    return found;
  };
}

/** Changes with everything that is drawn; limits move with the scale of their plot. */
function stampOf({ spans, limits }: AlarmMarks, plots: readonly MarkedPlot[]): string {
  if (spans.length === 0 && limits.length === 0) return "";
  const scales = limits.length === 0 ? "" : plots.map((plot) => `${plot.y(0)} ${plot.y(1)}`).join();
  return `${spans.length} ${spans.at(-1)?.t1} ${limits.map(({ subject, limit }) => subject + limit)} ${scales}`;
}

export const alarmLayer: PlotMarks = (store, viewState) => {
  const marks = alarmsOn(store, viewState);
  return {
    isBare: () => marks().spans.length === 0 && marks().limits.length === 0,
    stamp: (plots) => stampOf(marks(), plots),
    draw: (x, plots, w, look, hidden) => drawAlarms(x, plots, marks(), w, look, hidden),
  };
};

export function drawAlarms(
  x: CanvasRenderingContext2D,
  plots: readonly MarkedPlot[],
  marks: AlarmMarks,
  w: TimeWindow,
  look: Palette,
  hidden: ReadonlySet<string>,
): void {
  const subjects = plots.map(({ spec }) => subjectsOf(spec));
  const spans = spansByPlot(marks.spans, subjects);
  setFont(x, look, 11);
  x.textBaseline = "middle";
  plots.forEach((plot, k) => {
    const limits = marks.limits.filter(({ subject }) => subjectsOf(plot.spec, hidden).has(subject));
    for (const limit of limits) drawLimit(x, plot, limit, w, look);
    drawSpans(x, plot, spans[k] ?? [], w, look);
  });
}

function drawLimit(
  x: CanvasRenderingContext2D,
  plot: MarkedPlot,
  { limit, name, isError }: AlarmLimit,
  w: TimeWindow,
  look: Palette,
): void {
  const y = plot.top + plot.y(limit);
  if (!(y >= plot.top && y <= plot.top + plot.sheet.height)) return; // the scale follows the signal
  x.strokeStyle = look.colour[isError ? "status-bad" : "status-warn"];
  x.lineWidth = 1;
  x.setLineDash([6, 4]);
  x.beginPath();
  x.moveTo(w.left, Math.round(y) + 0.5);
  x.lineTo(w.left + w.width, Math.round(y) + 0.5);
  x.stroke();
  x.setLineDash([]);
  x.textAlign = "right";
  x.fillStyle = look.colour["ink-2"];
  const over = y - plot.top > 18 ? -7 : 8;
  x.fillText(fitting(x, name, NAME_PX), w.left + w.width - 4, y + over);
}

function drawSpans(
  x: CanvasRenderingContext2D,
  { top }: MarkedPlot,
  spans: readonly RaisedSpan[],
  w: TimeWindow,
  look: Palette,
): void {
  const rows = [...new Set(spans.map(({ alarm }) => alarm))];
  for (const { alarm, level, t0, t1 } of spans) {
    const end = t1 ?? w.t1;
    if (end < w.t0 || t0 > w.t1) continue;
    const [a, b] = [Math.max(w.left, xOf(w, t0)), Math.min(w.left + w.width, xOf(w, end))];
    const width = Math.max(MIN_PX, b - a);
    const y = top + 1 + Math.min(MAX_ROWS - 1, rows.indexOf(alarm)) * ROW_PX;
    x.fillStyle = look.colour[level === "error" ? "status-bad" : "status-warn"];
    x.fillRect(Math.min(a, w.left + w.width - MIN_PX), y, width, BAR_PX);
  }
}
