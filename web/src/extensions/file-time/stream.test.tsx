// @vitest-environment happy-dom
/** Clocks of a stream: measured when the panel is shown and on request, with the difference of each drawn. */
import { fireEvent, screen } from "@testing-library/preact";
import { expect, test } from "vitest";
import { newApp } from "../../testing/live-page";
import { answering } from "../../testing/recorded";
import { mountStream } from "./stream";

const START = 1_500_000_000;
const ARRIVAL = {
  name: "arrival",
  unit: "s",
  epoch: "1970",
  is_axis: false,
  why: "",
  samples: 400,
  resolution_s: 1e-5,
  rate_hz: 400,
  drift_ppm: 12.5,
  drift_error_ppm: 30.25,
  jitter_s: 5e-3,
  repeats: 0,
  gaps: 4,
  bursts: 0.875,
  burst_samples: 6.4,
  steps: [0, 1, 2, 3].map((n) => ({ kind: "restart", by_s: -2, row: n + 1, time: START + n })),
  steps_in_all: 4,
  use: "",
  difference: { times: [0, 1, 3].map((n) => START + n), low: [0, -1e-3, 0], high: [0, 1e-3, 0], edges: [START + 2] },
};

test("a stream is measured at once and again, and its clocks are drawn", async () => {
  const asked = answering({
    "GET /api/devices/1/clocks": {
      start: START,
      end: START + 4,
      sentences: ["The bytes came in 100 pieces."],
      messages: [{ device: "1", message: "MTData2", clocks: [ARRIVAL] }],
    },
  });
  const host = document.createElement("div");
  document.body.replaceChildren(host);
  const app = newApp();
  app.viewState.view.value = { ...app.viewState.view.peek(), device: "1" };
  const panel = mountStream(host, app);
  await screen.findByText("The bytes came in 100 pieces.");
  expect(screen.getAllByRole("row")[1]?.textContent).toBe("arrival s1970400 Hz10 µs+13 ±30 ppm5 ms4088 %, 6.4 at once");
  expect(screen.getByText("4 steps of arrival")).toBeTruthy();
  expect(screen.getByText("arrival, difference to the time axis: −1 ms … +1 ms")).toBeTruthy();
  expect(document.querySelectorAll(".file-time-band")).toHaveLength(2);
  expect(document.querySelectorAll(".file-time-step")).toHaveLength(4);
  expect(screen.getAllByText(/restarts, and goes back by 2 s/)).toHaveLength(4);
  fireEvent.click(screen.getByText("Measure again"));
  await screen.findByText("Measuring the clocks…");
  await screen.findByText(/^The last 4 s/);
  expect(asked.length).toBe(2);
  panel.dispose();
});
