// @vitest-environment happy-dom
/**
 * A result belongs to its question: for every panel and dialog that is registered, and every other part of the page with inputs and a
 * result. One that is not in a list here fails.
 *
 *     answered ──▶ an input changes ──▶ the result is dimmed, or gone ──▶ the server refuses ──▶ only the error is there
 */
import { act, fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, it, vi } from "vitest";
import { fromExtensions } from "../extension/extension";
import type { App } from "../page/context";
import { type Opened, openPage } from "../testing/live-page";
import { recorded } from "../testing/recorded";
import { DEFAULT_LAYOUT, show } from "../data/layout";
import type { RecorderState } from "../wire/types";
import { allPanels } from "./registry";

const FIGURES = {
  ...{ frequency: [1, 2, 3], psd: [1, 2, 3], tau: [1, 2, 3], adev: [1, 2, 3], low: [1, 2, 3], high: [1, 2, 3] },
  ...{ edges: [9, 9.5, 10], counts: [10, 30], density: [0.5, 1.5], n: 43, below: 1, above: 2, mean: 9.8, sigma: 0.4 },
  ...{ min: 9, max: 10, at_min: 1, at_max: 2, width: 0.5, time: [1, 2], step: 1, rate: 1, values: [1, 2], segments: 1 },
  ...{ notes: ["MARK"] },
};
const SIGNALS = ["x", "y", "z"].map((axis) => ({ signal: `A.${axis}`, device: "1", units: {}, figures: FIGURES }));
const CLOCKS = { start: 0, end: 9, sentences: ["MARK"], messages: [] };
const CALIBRATION = { is_running: false, report: null, write: null };
const KIND = { kind: "turn-on-bias", title: "MARK", problem: "", hint: "" };

interface Case {
  /** Routes that give the result; all others are answered as recorded. */
  readonly route: RegExp;
  readonly answer: unknown;
  /** In the text of the result. */
  readonly mark?: string;
  /** Puts it on screen. */
  readonly open: (page: Opened) => void | Promise<void>;
  /** Changes an input. */
  readonly change: (page: Opened) => void | Promise<void>;
}

const shown = (id: string) => (page: Opened) =>
  void (page.app.viewState.layout.value = show(DEFAULT_LAYOUT, { id, where: "main", optional: true }, true));
const overlay = (name: App["overlay"]["value"], about?: object) => (page: Opened) => {
  page.app.subject.value = about;
  page.app.overlay.value = name;
};
const otherSignal = (panel: "psd" | "allan" | "spectrogram") => (page: Opened) =>
  void (page.app.viewState.analyses.value = { [panel]: { signals: "RateOfTurn.z" } });
const type = (label: RegExp | string, value: string) => async () =>
  void fireEvent.input(await screen.findByLabelText(label), { target: { value } });
const otherDevice = (page: Opened) => {
  const [first] = page.store.devices.value;
  if (!first) throw new Error("no device");
  page.store.devices.value = [first, { ...first, id: "7", key: "7", name: "Other" }];
  page.look("7");
};
const measureAgain = async () => void fireEvent.click(await screen.findByRole("button", { name: "Measure again" }));
const ANALYSIS = { route: /POST \/api\/analysis\//, answer: SIGNALS };

/** Those whose result is asked of the server, by id. */
const ASKED: Readonly<Record<string, Case>> = {
  spectrum: { ...ANALYSIS, open: shown("spectrum"), change: otherSignal("psd") },
  allan: { ...ANALYSIS, open: shown("allan"), change: otherSignal("allan") },
  spectrogram: {
    ...ANALYSIS,
    answer: SIGNALS.map((one) => ({ ...one, figures: { ...FIGURES, psd: [FIGURES.psd, FIGURES.psd] } })),
    open: shown("spectrogram"),
    change: otherSignal("spectrogram"),
  },
  analysis: { ...ANALYSIS, open: shown("analysis"), change: type(/Signals or expressions/, "RateOfTurn.z") },
  histogram: {
    ...ANALYSIS,
    open: shown("histogram"),
    change: ({ app }) => void (app.viewState.histogram.value = { bins: 50 }),
  },
  "stream-time": {
    route: /GET \/api\/devices\/\w+\/clocks/,
    answer: CLOCKS,
    open: shown("stream-time"),
    change: measureAgain,
  },
  "file-time/clocks": {
    route: /GET \/api\/devices\/\w+\/clocks/,
    answer: CLOCKS,
    open: overlay("file-time/clocks"),
    change: measureAgain,
  },
  bytes: {
    route: /GET \/api\/devices\/\w+\/frames/,
    answer: {
      ...{ device: "1", protocol: "xbus", at: 0, time: null },
      packets: [{ arrival: 5, rank: 0, kind: "frame", name: "MARK", size: 4, gap_ms: null, hex: "FA", verdict: "" }],
    },
    open: shown("bytes"),
    change: ({ app, store }) => app.viewState.actions.pin((store.channels.value[0]?.ring.newest ?? NaN) - 1),
  },
  "alarms/dialog": {
    route: /POST \/api\/alarms\/(preview|check)/,
    answer: {
      ...{ valid: true, message: "", hint: "", begin: null, end: null, notes: [] },
      ...{ times: 3, t0: 0, t1: 9, worst: null, unit: "", intervals: [] },
    },
    mark: "raised 3 times",
    open: async (page) => {
      overlay("alarms/dialog")(page);
      await type("Condition", "norm(Acceleration) > 20")();
    },
    change: type("Condition", "norm(Acceleration) > 30"),
  },
  "expressions/dialog": {
    ...ANALYSIS,
    mark: "1.0000  2.0000",
    open: async (page) => {
      overlay("expressions/dialog", {})(page);
      await type("Expression", "norm(Acceleration)")();
    },
    change: type("Expression", "norm(RateOfTurn)"),
  },
  "calibration/dialog": {
    route: /GET \/api\/devices\/\w+\/calibration/,
    answer: { ...CALIBRATION, available: [KIND] },
    open: overlay("calibration/dialog"),
    change: otherDevice,
  },
  "shares/dialog": {
    route: /GET \/api\/devices\/\w+\/shares/,
    answer: { shares: [], changes: [], speaker: "", configuring: false, holder: 0, why_not: "MARK", folder: "" },
    open: overlay("shares/dialog"),
    change: otherDevice,
  },
  notes: {
    route: /GET \/api\/recordings$/,
    answer: [{ id: "yard", started: 0, notes: "MARK" }],
    open: (page) => {
      const recording: Partial<RecorderState> = { running: true, id: "yard", devices: [], headless: [], bytes: 0 };
      page.store.recorder.value = recording as RecorderState;
      shown("notes")(page);
    },
    change: ({ store }) => void (store.library.value += 1),
  },
  "ros2/topics": {
    route: /GET \/api\/ros2/,
    answer: {
      ...{ enabled: true, connected: true, router: "MARK", domain: 0, problem: "", hint: "", dropped: 0 },
      ...{ topics: [], missing: [] },
    },
    open: overlay("ros2/topics"),
    change: otherDevice,
  },
};

/** Those without a question to the server, and why no result of theirs can be old. */
const DRAWN: Readonly<Record<string, string>> = {
  attitude: "the sample that is read, named with its moment (attitude/panel.test.ts)",
  values: "the samples in memory, named with their moment and window",
  lanes: "the samples in memory, in every frame",
  xy: "pairs in memory in every frame; those of the server only for its axes (extensions/xy/server-pairs.test.ts)",
  track: "the samples in memory, in every frame",
  satellites: "the sample that is read, named with its moment",
  "map/dialog": "the track",
  events: "the events of the device, in every frame",
  health: "figures of the connection, dimmed without it (panels/health-panel.test.ts)",
  link: "figures of the connection, dimmed without it",
  alarms: "states of the connection, dimmed without it",
  "unknown-payloads": "the newest bytes, in every frame",
  "payloads/dialog": "a form without a result",
  "evidence/dialog": "makes a file of what its choices say, listed with its own title",
  scene: "a viewer of its own, opened for each device",
  "file-time": "of the open recording alone (extensions/file-time/panel.test.tsx)",
  "file-time/reading": "a recording's form: extensions/file-time/reading.test.ts",
};

it("every panel and dialog that is registered says here how its result is asked for", () => {
  const registered = [
    ...allPanels().map(({ id }) => id),
    ...fromExtensions("dialogs").map((one) => String(one.overlay)),
  ];
  expect(registered.filter((id) => !(id in ASKED) && !(id in DRAWN))).toEqual([]);
  expect([...Object.keys(ASKED), ...Object.keys(DRAWN)].filter((id) => !registered.includes(id))).toEqual([]);
});

/** Those that read at the cursor and say so in words of their own. */
const SAYING = ["panels/values.ts", "attitude/panel.ts", "pages/rows.tsx"];
/** Not ruled by the cursor: a press reads it, or another program shows the moment itself. */
const NOT_RULED = ["panels/signals/panel.tsx", "extensions/alarms/index.tsx", "extensions/viser/index.tsx"];

const placeOf = (file: string): string => file.replace(/^\.\//, "panels/").replace(/^\.\.\//, "");

it("every panel that reads at the cursor says so while that is off screen", () => {
  const sources = import.meta.glob<string>(["../**/*.{ts,tsx}", "!../**/*.test.*"], {
    eager: true,
    query: "?raw",
    import: "default",
  });
  const reads = Object.entries(sources).flatMap(([file, text]) =>
    /= (untracked\(\(\) => )?reading\((this\.#)?deps\)|[(,] ?reading\((this\.#)?deps\)/.test(text)
      ? [placeOf(file)]
      : [],
  );
  const declared = Object.entries(sources).flatMap(([file, text]) =>
    text.includes("readsCursor: true") ? [placeOf(file).replace(/index\.tsx?$/, "")] : [],
  );
  expect(reads.length).toBeGreaterThan(6);
  const silent = reads.filter((file) => !declared.some((folder) => file.startsWith(folder)));
  expect(silent.filter((file) => ![...SAYING, ...NOT_RULED, "panels/panel-host.tsx"].includes(file))).toEqual([]);
});

/** Regression: heading, horizon and body of 40 s ago stood at full brightness, and the mean was of another stretch than the values. */
it("a cursor off screen is named where it rules, and figures between two cursors are of what lies between them", async () => {
  const { app, store } = await openPage(recorded("xbus"));
  const { viewState } = app;
  await waitFor(() => expect(document.querySelector(".attitude .from")?.textContent).toBe("now, from quaternion"));
  const ring = store.channels.value.find(({ info }) => info.name === "Acceleration")?.ring;
  const [first, last] = [ring?.time(0) ?? NaN, ring?.time(ring.length - 1) ?? NaN];
  viewState.view.value = { ...viewState.view.value, live: false, end: last, span: (last - first) / 4 };
  viewState.cursor.value = { kind: "pinned", time: first };
  await waitFor(() =>
    expect(document.querySelector(".attitude.off-screen .from")?.textContent).toContain("off screen"),
  );
  await waitFor(() => expect(document.querySelector(".values-table thead")?.textContent).toMatch(/mean \d/));
  viewState.measure.value = first + (last - first) / 8;
  await waitFor(() => expect(document.querySelector(".values-table thead")?.textContent).toContain("mean A–B"));
});

/** Regression: health stayed at full brightness for 17 s after the server had gone, and its minute emptied. */
it("figures of a server that is gone are held and dimmed", async () => {
  const { store } = await openPage(recorded("xbus"));
  const device = store.devices.value[0]?.id;
  store.receive({ kind: "connection", state: "closed", nextTry: undefined });
  const own = store.channels.value.filter(({ info }) => info.device === device && info.id >= 0);
  const last = Math.max(...own.map(({ ring }) => ring.time(ring.length - 1)));
  vi.spyOn(store, "serverNow").mockReturnValue(last + 17);
  await waitFor(() =>
    expect(document.querySelector(".app.offline [data-panel=health] .when")?.textContent).toMatch(/held/),
  );
  expect(store.edgeOf(device)).toBe(last); // the minute and the window of mean and σ stay those of the last sample
});

const REFUSED = { kind: "bad-value", message: "REFUSED", hint: "" };

/** What the server does with a question about a result. */
type Mode = "answers" | "takes long" | "refuses";

for (const [id, { route, answer, mark = "MARK", open, change }] of Object.entries(ASKED))
  it(`the result of ${id} is dimmed once an input has changed, and an error takes its place`, async () => {
    const page = await openPage(recorded("xbus"));
    const recordedAnswers = globalThis.fetch;
    let mode: Mode = "answers";
    const waiting: (() => void)[] = [];
    vi.stubGlobal("fetch", async (address: string, init: RequestInit = {}) => {
      if (!route.test(`${init.method ?? "GET"} ${address.split("?")[0]}`)) return recordedAnswers(address, init);
      if (mode === "takes long") await new Promise<void>((resolve) => waiting.push(resolve));
      return mode === "refuses" ? Response.json(REFUSED, { status: 422 }) : Response.json(answer);
    });
    const results = (): readonly Element[] =>
      [...document.querySelectorAll(".result")].filter((one) => one.textContent?.includes(mark));
    const fresh = () => results().filter((one) => !one.hasAttribute("data-old"));
    await open(page);
    await waitFor(() => expect(fresh().length).toBeGreaterThan(0));
    mode = "takes long";
    await act(() => change(page));
    await waitFor(() => expect(fresh()).toEqual([])); // dimmed, or gone
    mode = "refuses";
    for (const go of waiting) go();
    await waitFor(() => expect(document.body.textContent).toContain("REFUSED"));
    expect(results()).toEqual([]);
  });

/** Questions about data, and the files that ask one for something else than a result on screen. */
const QUESTION =
  /"(POST \/api\/(analysis|comparison|query|alarms\/(check|preview))|GET [^"]*\/(clocks|calibration|shares|{robot}\/(settings|rollout)))[/"{]|configureApi\.compare\(/;
const OTHERWISE: Readonly<Record<string, string>> = {
  "../extensions/analysis/results.tsx": "copies the result as a text, by its own question",
  "../extensions/moments/go-to.tsx": "a place is gone to when it is asked for",
};

it("no file asks such a question without the one that knows to which question a result belongs", () => {
  const sources = import.meta.glob<string>(["../**/*.{ts,tsx}", "!../**/*.test.*", "!../wire/*"], {
    eager: true,
    query: "?raw",
    import: "default",
  });
  const bare = Object.entries(sources).filter(
    ([file, text]) => QUESTION.test(text) && !/use-answer|latest-answer/.test(text) && !(file in OTHERWISE),
  );
  expect(bare.map(([file]) => file)).toEqual([]);
});
