// @vitest-environment happy-dom
/** The comparison page: what is asked for, the plots, moving B, aligning, statistics and settings. */
import { signal } from "@preact/signals";
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { route } from "../../../page/route";
import type { App } from "../../../page/context";
import { answering, type Asked } from "../../../testing/recorded";
import type { ComparisonAnswer } from "../../../wire/routes";
import { CompareMain } from "./page";

const outline = (values: readonly (number | null)[]) => ({
  time: values.map((value, i) => (value === null ? null : 1000 + i)),
  low: values,
  high: values,
});
const FIGURES = { n: 4, mean: 0.5, sigma: 0.1, rms: 0.51, min: 0.3, max: 0.7, low: 0.31, high: 0.69 };
const ANSWER: ComparisonAnswer = {
  offset: 0,
  uncertainty: null,
  correlation: null,
  overlap: null,
  notes: [],
  signals: [
    {
      signal: "Quaternion.w",
      signal_b: "Quaternion.w",
      unit: "",
      a: outline([1, 2, null, 4]),
      b: outline([1, 2, 3, 4]),
      difference: outline([0.5, 0.5, null, 0.5]),
      figures: FIGURES,
      notes: ["2 samples of A in a gap of B: nothing is compared across a gap."],
    },
    {
      signal: "Attitude",
      signal_b: "Attitude",
      unit: "°",
      a: null,
      b: null,
      difference: outline([7, 7]),
      figures: { ...FIGURES, mounting: 7.01, remaining: 0.25 },
      notes: [],
    },
  ],
};
const ROUTE = "POST /api/comparison";
const connection = signal("open");

function open(query: string, answers: Record<string, unknown> = {}, otherName = "Quaternion"): readonly Asked[] {
  const asked = answering({ "GET /api/recordings": [], [ROUTE]: ANSWER, ...answers });
  const device = (id: string) => ({ id, name: `MTi ${id}`, product: "MTi", serial_number: id, status: "live" });
  const channel = (id: string, name: string) => ({ info: { name, kind: "quaternion", device: id, source: "" } });
  const store = {
    devices: signal([device("1"), device("2")]),
    channels: signal([channel("1", "Quaternion"), channel("2", otherName)]),
    connection,
    silentSince: signal(undefined),
    events: signal([
      { time: 1002, text: "kerb", device: "1" },
      { time: 1005.5, text: "kerb", device: "2" },
    ]),
    serverNow: () => 2000,
    edgeOf: () => 2000,
  };
  const app = { store, problem: signal(undefined), overlay: signal(undefined) } as unknown as App;
  location.hash = `#/recordings?${query}`;
  route.value = { page: "recordings", device: undefined, place: undefined, more: undefined, query };
  render(<CompareMain app={app} />);
  return asked;
}

const bodies = (asked: readonly Asked[]): readonly Record<string, unknown>[] =>
  asked.filter(({ path }) => path === "/api/comparison").map(({ body }) => body as Record<string, unknown>);

test("two live devices are compared by the clock, with plots, gaps, statistics and the angle", async () => {
  const asked = open("a=1&al=30");
  const chart = await screen.findByRole("slider", { name: /^Quaternion.w of A and B/ });
  expect(bodies(asked)[0]).toMatchObject({
    a: { source: "1", t0: 1970, t1: 2000 },
    b: { source: "2", t0: 1970, t1: 2000 },
    signals: ["Quaternion"],
    align: "offset",
    offset: 0,
  });
  expect(chart.querySelector(".side-a path")?.getAttribute("d")?.match(/M/g)?.length).toBe(2); // the gap is open
  expect(screen.getByRole("img", { name: "B − A, Quaternion.w" })).toBeTruthy();
  expect(screen.getByRole("img", { name: "Angle between the attitudes" })).toBeTruthy();
  expect(screen.getByText(/angle of 7.01 °.*0.25 ° rms remain. Two sensors mounted at an angle differ/)).toBeTruthy();
  expect(screen.getByText(/nothing is compared across a gap/)).toBeTruthy();
  expect(screen.getByText("0.31 … 0.69 °")).toBeTruthy();
  await waitFor(() => expect(location.hash).toContain("b=2"));
});

test("a library that could not be had while the server was away is asked for once it is back", async () => {
  let isAway = true;
  const list = () => (isAway ? new Response("", { status: 502 }) : []);
  const asked = open("a=1&al=30", { "GET /api/recordings": list });
  await screen.findByText(/502/);
  isAway = false;
  connection.value = "closed";
  connection.value = "open";
  await screen.findByRole("slider", { name: /^Quaternion.w of A and B/ });
  expect(bodies(asked)[0]).toMatchObject({ a: { source: "1" }, b: { source: "2" } });
  expect(screen.queryByText(/502/)).toBeNull();
});

test("a rotation that leaves much of the difference is not called a mounting", async () => {
  const signals = ANSWER.signals.map((one) =>
    one.signal === "Attitude" ? { ...one, figures: { ...FIGURES, mounting: 136.1, remaining: 35.81 } } : one,
  );
  open("a=1&al=30", { [ROUTE]: { ...ANSWER, signals } });
  expect(
    await screen.findByText(/136.1 °.*35.81 ° rms remain. A different mounting alone does not explain/),
  ).toBeTruthy();
});

test("a signal that B has under another name is proposed", async () => {
  const asked = open("a=1&al=30", {}, "DID_INS_2.qn2b");
  await screen.findByRole("slider", { name: /^Quaternion.w of A and B/ });
  expect(bodies(asked)[0]).toMatchObject({ signals: ["Quaternion"], signals_b: ["DID_INS_2.qn2b"] });
  await waitFor(() => expect(location.hash).toContain("signalb=DID_INS_2.qn2b"));
});

test("B is moved by keys, by hand, and at events", async () => {
  const asked = open("a=1&a0=1000&a1=1003&b=2&b0=1000&b1=1003&signal=Quaternion");
  const chart = await screen.findByRole("slider");
  fireEvent.keyDown(chart, { key: "ArrowRight", shiftKey: true });
  await waitFor(() => expect(bodies(asked).at(-1)).toMatchObject({ align: "offset", offset: 0.015 }));
  fireEvent.input(screen.getByLabelText("Offset of B (s)"), { target: { value: "-2.5" } });
  fireEvent.change(screen.getByLabelText("Offset of B (s)"), { target: { value: "-2.5" } });
  await waitFor(() => expect(bodies(asked).at(-1)).toMatchObject({ offset: -2.5 }));
  await waitFor(() => expect(location.hash).toContain("offset=-2.500000"));
  fireEvent.click(screen.getByRole("button", { name: "Align at events" }));
  fireEvent.change(screen.getByLabelText("Event of A"), { target: { value: "1002" } });
  fireEvent.change(screen.getByLabelText("Event of B"), { target: { value: "1005.5" } });
  await waitFor(() => expect(bodies(asked).at(-1)).toMatchObject({ offset: -3.5 }));
});

test("B is dragged: it moves at once, and is compared when it is let go", async () => {
  const asked = open("a=1&a0=1000&a1=1003&b=2&b0=1000&b1=1003&signal=Quaternion");
  const chart = await screen.findByRole("slider");
  const before = bodies(asked).length;
  fireEvent.pointerDown(chart, { button: 0, clientX: 100, pointerId: 1 });
  fireEvent.pointerMove(chart, { clientX: 164.4, pointerId: 1 });
  await waitFor(() => expect(chart.querySelector(".side-b")?.getAttribute("transform")).toBe("translate(64.4 0)"));
  expect(bodies(asked).length).toBe(before);
  fireEvent.pointerUp(chart, { clientX: 164.4, pointerId: 1 });
  await waitFor(() => expect(bodies(asked).at(-1)).toMatchObject({ align: "offset", offset: 0.3 }));
});

test("cross-correlation puts B where it fits and states the uncertainty", async () => {
  const aligned = { ...ANSWER, offset: 1.2345, uncertainty: 0.0021, correlation: 0.987, overlap: 29 };
  const asked = open("a=1&al=30&b=2&bl=30&signal=Quaternion");
  await screen.findByRole("slider");
  answering({ [ROUTE]: aligned });
  fireEvent.click(screen.getByRole("button", { name: "Align by cross-correlation" }));
  expect(await screen.findByText("1.2345 s ± 0.0021 s")).toBeTruthy();
  expect(screen.getByText("95 % interval; correlation 0.987 over 29 s")).toBeTruthy();
  await waitFor(() => expect(location.hash).toContain("offset=1.234500"));
  expect(asked.length).toBeGreaterThan(0);
});

test("the settings of both are a diff, on request", async () => {
  const rows = [{ setting: "OutputConfiguration", path: "x", title: "Acceleration", left: "400 Hz", right: "100 Hz" }];
  const asked = open("a=1&al=30&b=2&bl=30&signal=Quaternion", {
    "POST /api/comparison/settings": { left: "MTi 1, now", right: "MTi 2, now", rows, same: 41, missing: {} },
  });
  await screen.findByRole("slider");
  expect(asked.some(({ path }) => path.endsWith("/settings"))).toBe(false);
  const details = screen.getByText("Settings of both").closest("details") as HTMLDetailsElement;
  details.open = true;
  fireEvent(details, new Event("toggle"));
  expect(await screen.findByText("1 setting differs.")).toBeTruthy();
  expect(screen.getByText("400 Hz")).toBeTruthy();
  expect(screen.getByText("MTi 2, now")).toBeTruthy();
});

test("settings that agree are one sentence", async () => {
  open("a=1&al=30&b=2&bl=30&signal=Quaternion", {
    "POST /api/comparison/settings": { left: "MTi 1, now", right: "MTi 2, now", rows: [], same: 42, missing: {} },
  });
  await screen.findByRole("slider");
  const details = screen.getByText("Settings of both").closest("details") as HTMLDetailsElement;
  details.open = true;
  fireEvent(details, new Event("toggle"));
  expect(await screen.findByText("The settings agree.")).toBeTruthy();
});

/** Regression: recordings of one device without titles of their own were all called like it. */
test("untitled recordings are named by their time and device, and of one minute by their second", async () => {
  const devices = [{ id: "1", name: "MTi-630", product: "MTi-630" }];
  const recordings = [1_760_000_000, 1_760_000_005].map((started, id) => ({
    ...{
      id: `20251009T08532${id}Z`,
      title: "",
      notes: "",
      file: "",
      devices,
      started,
      deleted: null,
      recording: false,
    },
  }));
  open("a=1&al=30&b=2&bl=30&signal=Quaternion", { "GET /api/recordings": recordings });
  const begun = (time: string) => screen.findAllByRole("option", { name: `9 Oct 2025, 08:53 · MTi-630 · 08:${time}` });
  expect(await begun("53:20")).toHaveLength(2); // to choose as A, and as B
  expect(await begun("53:25")).toHaveLength(2);
});

test("a refused comparison says why", async () => {
  const problem = { kind: "no-result", message: "No offset stands out.", hint: "Choose another range." };
  open("a=1&al=30&b=2&bl=30&signal=Quaternion", {
    [ROUTE]: () => Response.json(problem, { status: 422 }),
  });
  expect(await screen.findByText("No offset stands out.")).toBeTruthy();
});

test("what is chosen while B is being aligned stays", async () => {
  const asked = open("a=1&al=30&b=2&bl=30&signal=Quaternion");
  await screen.findByRole("slider");
  const answered = globalThis.fetch;
  let answer: (() => void) | undefined;
  vi.stubGlobal("fetch", (address: string, init: RequestInit) =>
    String(init.body).includes('"correlation"')
      ? new Promise((resolve) => (answer = () => resolve(Response.json({ ...ANSWER, offset: 3, uncertainty: 0.1 }))))
      : answered(address, init),
  );
  fireEvent.click(screen.getByRole("button", { name: "Align by cross-correlation" }));
  await waitFor(() => expect(answer).toBeDefined());
  fireEvent.click(screen.getByRole("button", { name: "Swap A and B" }));
  await waitFor(() => expect(location.hash).toContain("a=2"));
  const before = bodies(asked).length;
  answer?.();
  await waitFor(() => expect(bodies(asked).slice(before)[0]).toMatchObject({ a: { source: "2" }, b: { source: "1" } }));
  expect(location.hash).toContain("a=2");
});
