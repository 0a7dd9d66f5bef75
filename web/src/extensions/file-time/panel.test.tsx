// @vitest-environment happy-dom
/** Clocks of a file: figures with their units, and steps that lead into the plots. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { newApp } from "../../testing/live-page";
import { reopened } from "../../page/route";
import { answering, type Answers } from "../../testing/recorded";
import { clock } from "../../ui/format/format";
import { shortDuration } from "./duration";
import { mountClocks } from "./panel";

const START = 1_500_000_000;
const AXIS = {
  name: "time",
  unit: "s",
  epoch: "1970",
  is_axis: true,
  why: "the heading names it",
  samples: 400,
  resolution_s: 0.01,
  rate_hz: 100,
  drift_ppm: null,
  jitter_s: null,
  repeats: 0,
  gaps: 1,
  bursts: 0.25,
  steps: [{ kind: "back", by_s: -2, row: 251, time: START + 2.59 }],
  steps_in_all: 21,
  use: "time (s)",
};
const OTHER = {
  ...AXIS,
  name: "seconds",
  is_axis: false,
  drift_ppm: -3.25,
  jitter_s: 6e-8,
  steps: [],
  steps_in_all: 0,
  use: "seconds",
};

function open(sentences: readonly string[], more: Answers = {}, isTable = true) {
  const asked = answering({
    ...more,
    "GET /api/recordings/yard/clocks": {
      start: START,
      end: START + 4,
      sentences,
      sure: "stated",
      reading: { rate: 50 },
      is_chosen: true,
      is_table: isTable,
      messages: [{ device: "1", message: "walk", clocks: [AXIS, OTHER] }],
    },
  });
  const host = document.createElement("div");
  document.body.replaceChildren(host);
  const jump = vi.fn();
  const app = newApp();
  mountClocks(host, { ...app, jump, recording: { id: "yard", rate: () => 0 } });
  return { jump, app, asked };
}

test("each clock has its figures, and a step leads to its moment", async () => {
  const { jump } = open(["The time axis is time in s."]);
  await screen.findByText("The time axis is time in s.");
  const rows = screen.getAllByRole("row").map((row) => row.textContent);
  expect(rows[1]).toContain("time axis");
  expect(rows[2]).toBe("seconds Use this clocks1970100 Hz10 ms−3.3 ppm60 ns1025 %");
  expect(screen.getByText("Steps in all: 21")).toBeTruthy();
  expect(document.querySelector(".file-time-strip path")?.getAttribute("d")).toBe("M647.5 0v12");
  fireEvent.click(screen.getByText(clock(START + 2.59, 3)));
  expect(jump).toHaveBeenCalledWith({ t0: START + 0.59, t1: START + 4.59 });
});

test("a recording of devices says which clock its axis is", async () => {
  open([]);
  await screen.findByText(/time of the devices/);
});

test("another clock is used, or the usual one again", async () => {
  const before = reopened.peek();
  const { asked } = open([], {
    "PUT /api/recordings/yard/reading": {},
    "DELETE /api/recordings/yard/reading": {},
  });
  fireEvent.click(await screen.findByText("Use this clock"));
  await waitFor(() => expect(reopened.peek()).toBe(before + 1));
  expect(asked.find(({ method }) => method === "PUT")?.body).toMatchObject({ time_column: "seconds", rate: 0 });
  fireEvent.click(screen.getByText("Automatic"));
  await waitFor(() => expect(reopened.peek()).toBe(before + 2));
});

test("a refused choice says why, and the clocks stay to choose again", async () => {
  const refusal = { kind: "busy", message: "It is being decoded.", hint: "" };
  const refused = (): Response => Response.json(refusal, { status: 409 });
  open([], { "DELETE /api/recordings/yard/reading": refused });
  fireEvent.click(await screen.findByText("Automatic"));
  expect(await screen.findByText(/It is being decoded/)).toBeTruthy();
  expect(screen.getByText("Automatic")).toBeTruthy();
});

test("a clock that is chosen for a device is not that of its replay, and the panel says so", async () => {
  open([], {}, false);
  expect(await screen.findByText(/Play as a device does not follow it/)).toBeTruthy();
  open([]);
  await screen.findByText("Chosen for this recording.");
  expect(screen.queryByText(/does not follow it/)).toBeNull();
});

test("a table can be read otherwise", async () => {
  const { app } = open([]);
  fireEvent.click(await screen.findByText("Read otherwise…"));
  expect(app.overlay.value).toBe("file-time/reading");
  expect(app.subject.value).toMatchObject({ reading: { rate: 50 }, is_chosen: true });
});

test("durations have three digits and a unit", () => {
  expect([2, 0.06, 6e-8, 1e-3, 90, 86_400 * 18, 0].map(shortDuration)).toEqual([
    "2 s",
    "60 ms",
    "60 ns",
    "1 ms",
    "1.5 min",
    "18 d",
    "0 s",
  ]);
});
