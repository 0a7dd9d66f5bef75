// @vitest-environment happy-dom
/** The preview of an alarm: what it asks, and what it says. */
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { answering } from "../../testing/recorded";
import { PreviewNote, previewWords } from "./preview";

const found = { times: 3, t0: 1000, t1: 1588, worst: 34.25, unit: "m/s²", seconds: 2, intervals: [] };
const condition = { kind: "expression", expression: "Acceleration.x > 1 g", clear: "" };

test("the sentence has how often, in which time, and the worst value", () => {
  expect(previewWords(found)).toBe("Would have been raised 3 times in the last 9.8 min; worst 34.250 m/s².");
  expect(previewWords({ ...found, times: 1, worst: null })).toBe("Would have been raised once in the last 9.8 min.");
  expect(previewWords({ ...found, times: 0 })).toBe("Would not have been raised in the last 9.8 min.");
  expect(previewWords({ ...found, t0: null, t1: null })).toBe("");
});

test("over a recording it has when, and each time is shown in the plots", async () => {
  const intervals = [0, 1, 2, 3, 4, 5].map((k) => ({ t0: 1000 + k, t1: 1000.25 + k, worst: 30 + k }));
  const asked = answering({ "POST /api/alarms/preview": { ...found, times: 9, intervals } });
  const show = vi.fn();
  const stamp = JSON.stringify({ name: "Shock", condition });
  render(<PreviewNote stamp={stamp} source="yard" recorded={{ device: "2", show }} />);
  const times = await screen.findByRole("list", { name: "Raised at" });
  expect(screen.getByRole("status").textContent).toContain(
    "Would have been raised 9 times in this recording; worst 34.250 m/s².",
  );
  expect(asked[0]?.body).toEqual({ definition: { name: "Shock", condition }, source: "yard", device: "2" });
  expect(times.textContent).toContain("00:16:42.000 for 250 ms, worst 32.000 m/s²");
  expect(times.textContent).toContain("and 4 more times");
  fireEvent.click(screen.getByRole("button", { name: "00:16:42.000" }));
  expect(show).toHaveBeenCalledWith(1002);
});

test("a valid definition is judged on the device, one that is not valid and one of a link figure are not", async () => {
  const asked = answering({ "POST /api/alarms/preview": found });
  const stamp = JSON.stringify({ name: "Shock", condition });
  const { rerender } = render(<PreviewNote stamp={undefined} source="1" />);
  rerender(<PreviewNote stamp={JSON.stringify({ condition: { kind: "health" } })} source="1" />);
  rerender(<PreviewNote stamp={stamp} source="1" />);
  await waitFor(() => expect(screen.getByRole("status").textContent).toContain("raised 3 times"));
  expect(asked).toHaveLength(1);
  expect(asked[0]?.body).toEqual({ definition: { name: "Shock", condition }, source: "1", seconds: 600 });
  rerender(<PreviewNote stamp={undefined} source="1" />);
  await waitFor(() => expect(screen.getByRole("status").textContent).toBe(""));
});
