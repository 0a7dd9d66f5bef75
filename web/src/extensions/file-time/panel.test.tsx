// @vitest-environment happy-dom
/** Clocks of a file: figures with their units, and steps that lead into the plots. */
import { fireEvent, screen } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { newApp } from "../../testing/live-page";
import { answering } from "../../testing/recorded";
import { clock } from "../../ui/format";
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
};
const OTHER = {
  ...AXIS,
  name: "seconds",
  is_axis: false,
  drift_ppm: -3.25,
  jitter_s: 6e-8,
  steps: [],
  steps_in_all: 0,
};

function open(sentences: readonly string[]) {
  answering({
    "GET /api/recordings/yard/clocks": {
      start: START,
      end: START + 4,
      sentences,
      sure: "stated",
      messages: [{ device: "1", message: "walk", clocks: [AXIS, OTHER] }],
    },
  });
  const host = document.createElement("div");
  document.body.replaceChildren(host);
  const jump = vi.fn();
  mountClocks(host, { ...newApp(), jump, recording: { id: "yard", rate: () => 0 } });
  return jump;
}

test("each clock has its figures, and a step leads to its moment", async () => {
  const jump = open(["The time axis is time in s."]);
  await screen.findByText("The time axis is time in s.");
  const rows = screen.getAllByRole("row").map((row) => row.textContent);
  expect(rows[1]).toContain("time axis");
  expect(rows[2]).toBe("seconds s1970100 Hz10 ms−3.3 ppm60 ns1025 %");
  expect(screen.getByText("Steps in all: 21")).toBeTruthy();
  expect(document.querySelector(".file-time-strip path")?.getAttribute("d")).toBe("M647.5 0v12");
  fireEvent.click(screen.getByText(clock(START + 2.59, 3)));
  expect(jump).toHaveBeenCalledWith({ t0: START + 0.59, t1: START + 4.59 });
});

test("a recording of devices says which clock its axis is", async () => {
  open([]);
  await screen.findByText(/time of the devices/);
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
