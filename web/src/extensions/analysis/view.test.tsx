// @vitest-environment happy-dom
/** An analysis: what is asked for, the figures that are shown, and mistakes in an expression. */
import { signal } from "@preact/signals";
import { fireEvent, render, screen, waitFor, within } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import type { Channel } from "../../data/channels";
import { createViewState } from "../../data/view-state";
import type { Deps } from "../../page/context";
import { answering, type Asked } from "../../testing/recorded";
import type { SignalFigures } from "../../wire/routes";
import { AnalysisView } from "./view";
import { colourAt, scaleOf, shareOf } from "../../charts/colours";
import { TEXT } from "./texts";
import { analysisCsv, signalNames, signalsIn, ends } from "./figures";

const ROUTE = "POST /api/analysis";
const UNITS = { psd: "m/s²/√Hz", frequency: "Hz", "peaks.rms": "m/s²", adev: "m/s²", mean: "m/s²" };
const PARAMETERS = {
  random_walk: { value: 0.002, low: 0.0019, high: 0.0021 },
  rate_random_walk: { value: 0, low: 0, high: 0.00034 },
};

function figures(axis: string): SignalFigures {
  const numbers = [1, 2, 3, 4, 5];
  return {
    signal: `Acceleration.${axis}`,
    device: "1",
    units: { ...UNITS, "parameters.random_walk.value": "m/s²/√Hz", "parameters.rate_random_walk.value": "m/s³/√Hz" },
    figures: {
      frequency: numbers,
      psd: numbers,
      tau: numbers,
      adev: numbers,
      low: numbers.map((n) => n * 0.9),
      high: numbers.map((n) => n * 1.1),
      model: numbers,
      peaks: [{ frequency: 31.7004, uncertainty: 0.0012, rms: 0.25, above_floor: 22.1, order: 2, harmonic_of: 15.85 }],
      parameters: PARAMETERS,
      data_sheet: numbers,
      verdicts: [{ parameter: "random_walk", state: "above", words: "Random walk 0.9 °/√h: 3 times the 0.3 °/√h." }],
      segments: 8,
      length: 256,
      rate: 100,
      n: 5000,
      mean: 9.81,
      notes: ["1 gap, 0.5 s in sum: nothing is computed across a gap."],
    },
  };
}

const channel = (name: string, kind: string, device = "1") =>
  ({ info: { name, kind, device, source: "" } }) as unknown as Channel;
const CHANNELS = [
  channel("RateOfTurn", "vector"),
  channel("Acceleration", "vector"),
  channel("StatusWord", "status"),
  channel("Other", "vector", "2"),
];

function open(
  answers: Record<string, unknown>,
  isLive = false,
  prefix = "",
  viewState = createViewState(),
  edge = 2000,
): readonly Asked[] {
  const asked = answering(answers);
  viewState.view.value = { device: "1", live: isLive, end: 1000, span: 20, timeBase: "arrival" };
  const store = { channels: signal(CHANNELS), serverNow: () => 2000, edgeOf: () => edge };
  const deps = { store, viewState } as unknown as Deps;
  render(<AnalysisView deps={deps} source="7" title="MTi-630" prefix={prefix} isLive={isLive} />);
  return asked;
}

const bodies = (asked: readonly Asked[]): readonly Record<string, unknown>[] =>
  asked.map(({ body }) => body as Record<string, unknown>);

test("the spectrum of the window is shown first, with its peaks and notes", async () => {
  const asked = open({ [`${ROUTE}/psd`]: ["x", "y", "z"].map(figures) });
  expect(await screen.findByRole("img", { name: /Spectrum of Acceleration.x, Acceleration.y/ })).toBeTruthy();
  expect(bodies(asked)[0]).toEqual({
    signals: ["Acceleration"],
    options: { window: "hann", length: 0, scale: "amplitude" },
    source: "7",
    base: "arrival",
    t0: 980,
    t1: 1000,
  });
  const peaks = screen.getByRole("region", { name: "Peaks" });
  expect(peaks.textContent).toContain("31.7004 ± 0.0012 Hz");
  expect(peaks.textContent).toContain("2 × 15.85 Hz");
  expect(screen.getByText(/nothing is computed across a gap/)).toBeTruthy();
  expect(screen.getByText(/8 segments of 256 samples at 100 Hz/)).toBeTruthy();
});

test("the live window of a device that ended is the one on screen, not the last seconds by the clock", async () => {
  const asked = open({ [`${ROUTE}/psd`]: [figures("x")] }, true, "", createViewState(), 1500);
  await screen.findByRole("region", { name: "Peaks" });
  expect(bodies(asked)[0]).toMatchObject({ t0: 1480, t1: 1500 });
});

test("cursors that are set are what is asked, and a result names its question", async () => {
  const viewState = createViewState();
  const asked = open({ [`${ROUTE}/psd`]: [figures("x")] }, false, "", viewState);
  expect((await screen.findByText(/^Acceleration · MTi-630/)).textContent).toBe(
    "Acceleration · MTi-630 · 00:16:20.0 to 00:16:40.0 UTC",
  );
  viewState.cursor.value = { kind: "pinned", time: 990 };
  viewState.measure.value = 992;
  await screen.findByText(/00:16:30.0 to 00:16:32.0/);
  expect(bodies(asked).at(-1)).toMatchObject({ t0: 990, t1: 992 });
});

test("a pinned result stays in the chart beside the next one", async () => {
  const viewState = createViewState();
  open({ [`${ROUTE}/psd`]: [figures("x")] }, false, "", viewState);
  fireEvent.click(await screen.findByRole("button", { name: TEXT.pin }));
  viewState.view.value = { ...viewState.view.value, end: 900 };
  await screen.findByText(/00:14:40.0 to 00:15:00.0/);
  const pinned = screen.getByText(/^Pinned: Acceleration · MTi-630 · 00:16:20.0 to 00:16:40.0/);
  await waitFor(() => expect(document.querySelectorAll("path.trace")).toHaveLength(2));
  fireEvent.click(within(pinned).getByRole("button", { name: TEXT.unpin }));
  await waitFor(() => expect(document.querySelectorAll("path.trace")).toHaveLength(1));
});

test("the Allan deviation is asked of everything; a parameter that is not seen has its limit", async () => {
  const asked = open({ [`${ROUTE}/psd`]: [figures("x")], [`${ROUTE}/allan`]: [figures("x")] });
  await screen.findByRole("region", { name: "Peaks" });
  fireEvent.click(screen.getByRole("button", { name: "Allan deviation" }));
  const table = await screen.findByRole("region", { name: "Noise parameters" });
  expect(
    within(table)
      .getByText(/Random walk N/)
      .closest("tr")?.textContent,
  ).toContain("0.002 m/s²/√Hz");
  expect(
    within(table)
      .getByText(/Rate random walk K/)
      .closest("tr")?.textContent,
  ).toContain("at most 3.4·10⁻⁴");
  expect(bodies(asked).at(-1)).toMatchObject({
    t0: null,
    t1: null,
    signals: ["Acceleration", "RateOfTurn"],
    options: { motion: "exclude", temperature: "exclude" },
  });
  const verdicts = screen.getByRole("list", { name: "Comparison with the data sheet" });
  expect(verdicts.textContent).toContain("▲ Above");
  expect(verdicts.textContent).toContain("x Random walk 0.9 °/√h: 3 times the 0.3 °/√h.");
  fireEvent.click(screen.getByRole("button", { name: "Copy for Kalibr" }));
  await waitFor(() =>
    expect(bodies(asked).at(-1)).toMatchObject({ format: "kalibr", signals: ["Acceleration", "RateOfTurn"] }),
  );
});

test("what prevents a verdict stands above the curve, without parameters, and nothing can be copied", async () => {
  const moving = figures("x");
  const { parameters: _, model: __, ...kept } = moving.figures;
  const words = { message: "Moving: 38 s of 49 s.", hint: "Lay the sensor down for 20 minutes." };
  const verdicts = [{ parameter: "random_walk", state: "open", words: "Random walk: not compared." }];
  const prevented = { ...moving, figures: { ...kept, verdicts, obstacles: [{ check: "motion", ...words }] } };
  open({ [`${ROUTE}/psd`]: [figures("x")], [`${ROUTE}/allan`]: [prevented, figures("y")] });
  await screen.findByRole("region", { name: "Peaks" });
  fireEvent.click(screen.getByRole("button", { name: "Allan deviation" }));
  const list = await screen.findByRole("list", { name: "No noise parameters and verdicts, because" });
  expect(list.textContent).toBe("x: Moving: 38 s of 49 s. Lay the sensor down for 20 minutes.");
  const curve = screen.getByRole("img", { name: /Allan deviation of Acceleration.x/ });
  expect(list.compareDocumentPosition(curve) & Node.DOCUMENT_POSITION_FOLLOWING).toBeTruthy();
  const row = screen.getByText(/Random walk N/).closest("tr");
  expect([...(row?.querySelectorAll("td") ?? [])].map((cell) => cell.textContent?.slice(0, 5))).toEqual(["—", "0.002"]);
  expect(screen.queryByRole("button", { name: /^Copy/ })).toBeNull();
});

test("an interval is rounded outwards, so that its value lies inside as printed", () => {
  expect(ends(0.0019843, 0.0020012)).toEqual(["0.00198", "0.00201"]);
  expect(ends(0.0020311, 0.0020349)).toEqual(["0.00203", "0.00204"]);
  expect(ends(0, 0.00034)).toEqual(["0", "3.4·10⁻⁴"]);
  expect(ends(0.03, 271)).toEqual(["0", "271"]);
});

test("a spectrogram of each signal is drawn, with its scale", async () => {
  const rows = [0, 1, 2].map((i) => [0, 1e-6 * (i + 1), 1e-3 * (i + 1)]);
  const picture = { time: [1000, 1001, 1002], frequency: [0, 10, 20], psd: rows, step: 100, rate: 100, notes: [] };
  const found = { signal: "Acceleration.x", device: "1", units: { psd: "m/s²/√Hz" }, figures: picture };
  const asked = open({ [`${ROUTE}/psd`]: [figures("x")], [`${ROUTE}/spectrogram`]: [found] });
  await screen.findByRole("region", { name: "Peaks" });
  fireEvent.click(screen.getByRole("button", { name: "Spectrogram" }));
  expect(await screen.findByRole("img", { name: "Spectrogram of Acceleration.x" })).toBeTruthy();
  expect(screen.getByText(/10⁻⁶ … 0.003 m\/s²\/√Hz/)).toBeTruthy();
  expect(screen.getByText("00:16:40.0")).toBeTruthy();
  expect(bodies(asked).at(-1)).toMatchObject({ options: { overlap: 0.75, length: 0, scale: "amplitude" } });
});

test("signals are listed with commas; those within parentheses belong to an expression", () => {
  expect(signalsIn("Acceleration, RateOfTurn.x")).toEqual(["Acceleration", "RateOfTurn.x"]);
  expect(signalsIn(' lowpass(Acceleration.x, 5 Hz) ,"2/Rate, of turn.z",')).toEqual([
    "lowpass(Acceleration.x, 5 Hz)",
    '"2/Rate, of turn.z"',
  ]);
  expect(signalsIn("")).toEqual([""]);
});

test("the scale of a picture holds its brightest figure and 60 dB below it", () => {
  const scale = scaleOf([null, 0, 1e-12, 1e-3, 1], false);
  expect(scale).toEqual({ low: 1e-6, high: 1 });
  if (!scale) return;
  expect(shareOf(scale, 1)).toBe(1);
  expect(shareOf(scale, 1e-3)).toBeCloseTo(0.5);
  expect(shareOf(scale, null)).toBe(0);
  expect(scaleOf([null, 0], false)).toBeUndefined();
  const light = [0, 0.25, 0.5, 0.75, 1].map((share) => colourAt(share).reduce((sum, one) => sum + one, 0));
  expect([...light].sort((a, b) => a - b)).toEqual(light);
});

test("an expression is sent as typed, and its mistake takes the place of the last figures", async () => {
  const problem = {
    kind: "bad-expression",
    message: "There is no function nrom. (character 1)",
    hint: "Did you mean norm?",
  };
  const answers: Record<string, unknown> = { [`${ROUTE}/psd`]: [figures("x")] };
  const asked = open(answers, false, "2/");
  await screen.findByRole("region", { name: "Peaks" });
  expect(bodies(asked)[0]?.["signals"]).toEqual(["2/Acceleration"]);
  vi.stubGlobal("fetch", async (_: string, init: RequestInit) => {
    expect(JSON.parse(String(init.body)).signals).toEqual(["nrom(Acceleration)"]);
    return Response.json(problem, { status: 422 });
  });
  fireEvent.input(screen.getByRole("combobox", { name: /Signals or expressions/ }), {
    target: { value: "nrom(Acceleration)" },
  });
  expect((await screen.findByRole("alert")).textContent).toContain("Did you mean norm?");
  expect(screen.queryByRole("region", { name: "Peaks" })).toBeNull();
});

test("live figures are asked for again", async () => {
  const asked = open({ [`${ROUTE}/psd`]: [figures("x")] }, true);
  await waitFor(() => expect(asked.length).toBeGreaterThan(1), { timeout: 5000 });
  expect(bodies(asked)[1]).toMatchObject({ t0: 1980, t1: 2000 });
});

test("the figures of a recording follow its window, and are not asked for again while it stands", async () => {
  const viewState = createViewState();
  const asked = open({ [`${ROUTE}/psd`]: [figures("x")] }, false, "", viewState);
  await waitFor(() => expect(asked.length).toBe(1));
  viewState.view.value = { ...viewState.view.value, end: 900 };
  await waitFor(() => expect(asked.length).toBe(2), { timeout: 5000 });
  expect(bodies(asked)[1]).toMatchObject({ t0: 880, t1: 900 });
  viewState.view.value = { ...viewState.view.value, timeBase: "device" };
  await waitFor(() => expect(bodies(asked)[2]).toMatchObject({ base: "device" }), { timeout: 5000 });
  expect(asked.length).toBe(3);
});

test("channels that are numbers are offered, acceleration first", () => {
  expect(signalNames(CHANNELS, "1")).toEqual(["Acceleration", "RateOfTurn"]);
});

test("figures are copied as CSV", () => {
  const lines = analysisCsv("psd", [figures("x"), figures("y")]).split("\n");
  expect(lines[0]).toBe("frequency (Hz),Acceleration.x (m/s²/√Hz),Acceleration.y (m/s²/√Hz)");
  expect(lines[1]).toBe("1,1,1");
  expect(analysisCsv("statistics", [figures("x")])).toContain("mean,m/s²,9.81");
});
