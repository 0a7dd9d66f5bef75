import { expect, it, vi } from "vitest";
import { frameChange } from "../../data/frames";
import { Ring } from "../../data/ring-buffer";
import type { Series } from "../../data/view";
import { CHANNELS } from "../../testing/synthetic";
import type { HttpProblem } from "../../requests/http";
import type { AnalysisRequest } from "../../wire/routes";
import type { ChannelInfo } from "../../wire/types";
import { type FigureSource, wantedOf } from "../../measure/figure-source";
import { displayed, ServerFigures } from "./server-figures";

const acceleration = CHANNELS.find(({ kind }) => kind === "vector")!;
const angles: ChannelInfo = {
  ...acceleration,
  id: 70,
  name: "Attitude",
  kind: "euler",
  frame: "ENU from body",
  unit: "°",
  columns: ["roll", "pitch", "yaw"].map((name) => ({
    ...acceleration.columns[0]!,
    name,
    axis: "",
    unit: "°",
    period: 360,
  })),
};
const rotation: ChannelInfo = {
  ...angles,
  id: 71,
  name: "Quaternion",
  kind: "quaternion",
  columns: ["w", "x", "y", "z"].map((name) => ({ ...angles.columns[0]!, name, period: 0, unit: "" })),
};
const sent = [acceleration, angles, rotation];
const source: FigureSource = {
  id: "yard",
  prefix: ({ device }) => `${device}/`,
  sent: (id) => sent.find((one) => one.id === id),
  changeOf: () => undefined,
};
const inNed: FigureSource = {
  ...source,
  changeOf: (id) => frameChange(sent.find((one) => one.id === id)!, "ENU", "NED"),
};

const seriesOf = (info: ChannelInfo, column: number): Series => ({
  channel: { info, ring: new Ring([]) },
  column,
  key: `${info.name}.${info.columns[column]!.name}`,
  label: "",
  colour: "axis-n",
  dash: [],
  norm: false,
  decimals: 3,
});
const wordOf = (series: Series, from = source) => wantedOf(series, from)?.word;

it("asks for columns as they were sent", () => {
  const { device, name } = acceleration;
  expect(wordOf(seriesOf(acceleration, 1))).toBe(`${device}/${name}.y`);
  const norm = {
    ...acceleration,
    columns: [...acceleration.columns.slice(0, 3), { ...acceleration.columns[0]!, name: "norm" }],
  };
  expect(wordOf(seriesOf(norm, 3))).toBe(`norm("${device}/${name}")`);
  const derived = { ...angles, id: -1 - rotation.id };
  expect(wantedOf(seriesOf(derived, 2), source)).toMatchObject({ word: `euler("${device}/Quaternion")`, part: 2 });
  expect(wantedOf(seriesOf(derived, 2), inNed)).toBeUndefined();
  expect(wordOf(seriesOf(rotation, 0), inNed)).toMatch(
    /^\(-?0\.7\d+\) \* ".*Quaternion\.w" \+ \(.*\) \* ".*Quaternion\.z"$/,
  );
});

it("asks for nothing of another source, whose ids mean other channels", () => {
  expect(wantedOf(seriesOf({ ...acceleration, id: rotation.id }, 0), source)).toBeUndefined();
  expect(wantedOf(seriesOf({ ...acceleration, device: "9" }, 0), source)).toBeUndefined();
});

it("changes figures to the frame shown, and gives none that it cannot know", () => {
  const figures = {
    n: 5,
    gaps: 1,
    mean: 100,
    sigma: 2,
    rms: 101,
    min: 90,
    max: 110,
    peak_to_peak: 20,
    slope: 4,
    integral: null,
  };
  const yaw = wantedOf(seriesOf(angles, 2), inNed)!;
  expect(displayed(figures, yaw)).toEqual({
    n: 5,
    gaps: 1,
    mean: -10,
    sigma: 2,
    rms: NaN,
    min: NaN,
    max: NaN,
    peakToPeak: 20,
    slope: -4,
    integral: NaN,
  });
  const pitch = wantedOf(seriesOf(angles, 1), inNed)!;
  expect(displayed(figures, pitch)).toMatchObject({ mean: -100, min: -110, max: -90, rms: 101, slope: -4 });
});

const range = { t0: 10, t1: 20, base: "device" } as const;
const problem = (kind: string): HttpProblem => ({ kind, message: kind, hint: "", status: 404 });

it("asks once for a range, and for each signal alone if one of them has no sample", async () => {
  const asked: (readonly string[])[] = [];
  const figures = new ServerFigures(source, async ({ signals }: AnalysisRequest) => {
    asked.push(signals);
    const isThere = !signals.some((one) => one.endsWith(".y"));
    return isThere
      ? { ok: true, value: signals.map((signal) => ({ signal, device: "1", units: {}, figures: { n: 7, mean: 1 } })) }
      : { ok: false, problem: problem("not-found") };
  });
  const [x, y] = [seriesOf(acceleration, 0), seriesOf(acceleration, 1)];
  figures.want([x, y], range, 1000);
  await vi.waitFor(() => expect(figures.of(x, range)?.n).toBe(7));
  expect(figures.of(y, range)).toMatchObject({ n: 0, gaps: 0, mean: NaN });
  expect(figures.of(x, { ...range, t1: 21 })).toBeUndefined();
  expect([asked.length, figures.problem]).toEqual([3, undefined]);
  figures.want([x, y], range, 2000);
  expect(asked.length).toBe(3);
});

it("keeps the problem of a request that failed, and asks again later", async () => {
  let answers = 0;
  const figures = new ServerFigures(source, async () => {
    answers += 1;
    return { ok: false, problem: problem("too-many") };
  });
  const x = seriesOf(acceleration, 0);
  figures.want([x], range, 1000);
  await vi.waitFor(() => expect(figures.problem?.message).toBe("too-many"));
  expect(figures.of(x, range)).toBeUndefined();
  figures.want([x], range, 2000);
  expect(answers).toBe(1);
  await vi.waitFor(() => {
    figures.want([x], range, 5000);
    expect(answers).toBe(2);
  });
});
