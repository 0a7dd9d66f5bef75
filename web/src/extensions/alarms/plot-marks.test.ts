/** Alarms on the plots: which plot has which interval and limit, and marks that no zoom hides. */
import { expect, test } from "vitest";
import type { RaisedSpan } from "./states";
import type { AlarmInfo } from "../../wire/routes";
import type { EventInfo } from "../../wire/types";
import { eventInfo } from "../../testing/fixtures";
import { alarmMarks, drawAlarms, spansByPlot, subjectsOf } from "./plot-marks";
import type { Palette } from "../../plots/canvas-style";
import type { PlotSpec } from "../../data/view";
import type { TimeWindow } from "../../plots/time-window";

const COLUMNS = ["x", "y", "z"].map((name) => ({ name }));
const series = (channel: string, column: number, norm = false) => ({
  channel: { info: { name: channel, columns: COLUMNS } },
  column,
  norm,
  key: norm ? "hidden" : channel + column,
});
const spec = (...all: ReturnType<typeof series>[]) => ({ series: all }) as unknown as PlotSpec;
const ACCELERATION = spec(series("Acceleration", 0), series("Acceleration", 1), series("Acceleration", 0, true));
const RATE = spec(series("RateOfTurn", 0));

const raised = (alarm: string, signals: readonly string[], t0 = 10, t1: number | undefined = 11): RaisedSpan => ({
  alarm,
  name: alarm,
  level: "warning",
  signals,
  subject: signals[0] ?? "",
  limit: undefined,
  t0,
  t1,
});

test("a plot knows its channel, its columns and its norm by the names of conditions", () => {
  expect([...subjectsOf(ACCELERATION)].sort()).toEqual([
    "Acceleration",
    "Acceleration.x",
    "Acceleration.y",
    "norm(Acceleration)",
  ]);
});

test("the limit of a hidden series is not shown", () => {
  expect(subjectsOf(ACCELERATION, new Set(["hidden"])).has("norm(Acceleration)")).toBe(false);
});

test("an interval is on the plots of its signals, one of a link on the first", () => {
  const plots = [subjectsOf(ACCELERATION), subjectsOf(RATE)];
  const spans = [raised("a", ["RateOfTurn.x"]), raised("b", ["Acceleration.y", "RateOfTurn.x"]), raised("c", [])];
  const names = spansByPlot(spans, plots).map((of) => of.map(({ alarm }) => alarm));
  expect(names).toEqual([
    ["c", "b"],
    ["a", "b"],
  ]);
});

const event = (limit: number): EventInfo => {
  const what = { alarm: "a", name: "A", change: "raised", subject: "Acceleration.x", signals: ["Acceleration.x"] };
  return eventInfo({ time: 10, kind: "alarm", data: { ...what, limit } });
};

test("a recording has the limit of its events, a live page the present one", () => {
  expect(alarmMarks([event(3)], [], "1").limits.map(({ limit }) => limit)).toEqual([3]);
  const now = {
    id: "a",
    definition: { name: "A", level: "error" },
    states: [
      {
        device: "1",
        subject: "Acceleration.x",
        limit: 5,
        signals: [],
        intervals: [
          { t0: 2, t1: 3 },
          { t0: 10, t1: null },
        ],
      },
    ],
  } as unknown as AlarmInfo;
  const marks = alarmMarks([event(3)], [now], "1");
  expect(marks.limits).toEqual([{ name: "A", subject: "Acceleration.x", limit: 5, isError: true }]);
  expect(marks.spans.map(({ t0, t1 }) => [t0, t1])).toEqual([
    [10, undefined],
    [2, 3],
  ]);
  expect(alarmMarks([event(3)], [now], "2")).toEqual({ spans: [], limits: [] });
});

function drawn(spans: readonly RaisedSpan[], limit: number) {
  const rects: number[][] = [];
  const lines: number[] = [];
  const x = {
    fillRect: (...all: number[]) => rects.push(all),
    lineTo: (_: number, y: number) => lines.push(y),
    measureText: () => ({ width: 10 }),
    moveTo: () => undefined,
    beginPath: () => undefined,
    stroke: () => undefined,
    setLineDash: () => undefined,
    fillText: () => undefined,
  } as unknown as CanvasRenderingContext2D;
  const w = { t0: 0, t1: 1000, span: 1000, left: 100, width: 500, base: "arrival" } as unknown as TimeWindow;
  const plot = { spec: ACCELERATION, top: 50, sheet: { height: 100 }, y: (value: number) => 100 - value };
  const limits = [{ name: "A", subject: "Acceleration.x", limit, isError: false }];
  const look = { colour: {}, font: "" } as unknown as Palette;
  drawAlarms(x, [plot], { spans, limits }, w, look, new Set(["hidden"]));
  return { rects, lines };
}

test("an interval of a millisecond in a thousand seconds is four pixels wide, also at the very end", () => {
  const { rects } = drawn(
    [
      raised("a", ["Acceleration.x"], 500, 500.001),
      raised("a", ["Acceleration.x"], 999.999, undefined),
      raised("a", ["Acceleration.x"], -9, -8),
    ],
    500,
  );
  expect(rects.map(([from, , width]) => [from, width])).toEqual([
    [350, 4],
    [596, 4],
  ]);
});

test("the limit is a line where the scale shows it, and is left out where it does not", () => {
  expect(drawn([], 30).lines).toEqual([120.5]);
  expect(drawn([], 500).lines).toEqual([]);
});
