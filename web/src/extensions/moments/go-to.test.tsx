// @vitest-environment happy-dom
/** The bar that goes to a moment: times, places of each kind, and conditions with their mistakes. */
import { cleanup, fireEvent, render, screen } from "@testing-library/preact";
import { beforeEach, expect, it, vi } from "vitest";
import { createViewState, type ViewState } from "../../data/view-state";
import { answering, type Answers, type Asked } from "../../testing/recorded";
import { GoTo } from "./go-to";
import { openGoTo, stateOf, stepPlace } from "./state";

const START = Date.UTC(2025, 9, 9, 8, 53, 20) / 1000;
const ROUTE = "POST /api/analysis/intervals";
let state: ViewState;
let halted = 0;

beforeEach(() => {
  state = createViewState();
  halted = 0;
  state.actions.attachPlots({
    now: () => START + 100,
    bounds: () => ({ first: START, last: START + 100 }),
    step: (t, steps) => t + steps,
    nearest: () => undefined,
    plots: () => [],
    series: () => [],
    beside: () => [],
  });
  state.view.value = { ...state.view.peek(), device: "2", live: false, end: START + 20, span: 20 };
});
function open(answers: Answers = {}): readonly Asked[] {
  const asked = answering(answers);
  const places = { event: [START + 5, START + 50], marker: [START + 7], gap: [] };
  const deps = { viewState: state, source: () => "yard", places: (kind: keyof typeof places) => places[kind] };
  render(<GoTo deps={{ ...deps, halt: () => void (halted += 1) }} />);
  openGoTo(state);
  return asked;
}
const input = () => screen.findByRole<HTMLInputElement>("textbox");
const type = async (text: string, more = {}): Promise<void> => {
  fireEvent.input(await input(), { target: { value: text } });
  if ("shiftKey" in more) fireEvent.keyDown(await input(), { key: "Enter", ...more });
  else fireEvent.submit((await input()).form as HTMLFormElement);
};
const at = (): number => (state.actions.cursorTime() ?? NaN) - START;
const said = (): string => screen.getByRole("status").textContent ?? "";

it("goes to a time, and from there on", async () => {
  open();
  await type("08:54:00");
  expect([at(), halted]).toEqual([40, 1]);
  expect(state.view.peek()).toMatchObject({ live: false, span: 20 });
  expect(state.view.peek().end).toBeCloseTo(START + 50, 6);
  await type("-2.5 s");
  expect(at()).toBe(37.5);
  await type("12:00");
  expect(at()).toBe(37.5);
  await vi.waitFor(() => expect(said()).toBe("The data are from 08:53:20 to 08:55:00 UTC."));
});

it("is unchanged after its page is rebuilt, with the caret after the typed text", async () => {
  open();
  await type("12:00");
  await vi.waitFor(() => expect(said()).toBe("The data are from 08:53:20 to 08:55:00 UTC."));
  cleanup();
  render(<GoTo deps={{ viewState: state, source: () => "yard", places: () => [] }} />);
  const field = await input();
  expect(said()).toBe("The data are from 08:53:20 to 08:55:00 UTC.");
  expect([document.activeElement, field.value]).toEqual([field, "12:00"]);
  expect([field.selectionStart, field.selectionEnd]).toEqual([5, 5]);
});

it("goes to the newest place where nothing can come after now", async () => {
  const figures = { begin: [START + 90], end: [START + 90], total: 66 };
  const asked = open({ [ROUTE]: [{ signal: "a > 1", device: "2", units: {}, figures }] });
  state.actions.live();
  await type("a > 1");
  await vi.waitFor(() => expect(said()).toMatch(/true at one sample/));
  expect(asked[0]?.body).toMatchObject({ options: { before: START + 100, order: "descending" } });
  expect(at()).toBe(90);
  state.actions.unpin();
  state.actions.live();
  stateOf(state).bar.value = { ...stateOf(state).bar.peek(), kind: "event" };
  stepPlace(state, true);
  expect(at()).toBe(50);
});

it("goes to the next and previous place of a kind", async () => {
  open();
  state.actions.pin(START + 6);
  await input();
  stepPlace(state, true);
  expect(at()).toBe(50);
  stepPlace(state, true);
  await vi.waitFor(() => expect(said()).toBe("No event after this."));
  fireEvent.change(screen.getByRole("combobox"), { target: { value: "marker" } });
  stepPlace(state, false);
  expect(at()).toBe(7);
  fireEvent.change(screen.getByRole("combobox"), { target: { value: "sample" } });
  fireEvent.click(screen.getByRole("button", { name: "Next (N)" }));
  expect(at()).toBe(8);
  fireEvent.keyDown(await input(), { key: "Escape" });
  await vi.waitFor(() => expect(screen.queryByRole("textbox")).toBeNull());
});

it("goes to where a condition is true, after and before the cursor", async () => {
  const figures = { total: 3, begin: [START + 30], end: [START + 30.25], samples: 9 };
  const asked = open({ [ROUTE]: [{ signal: "", device: "2", units: {}, figures }] });
  state.actions.pin(START + 6);
  await type("norm(acc) > 3 g");
  await vi.waitFor(() => expect(at()).toBe(30));
  expect(said()).toContain("08:53:50.000 UTC, true for 250.0 ms; 2 others beyond");
  const body = { source: "yard", device: "2", signals: ["norm(acc) > 3 g"], t0: null, t1: null };
  expect(asked[0]?.body).toMatchObject({ ...body, options: { after: START + 6, order: "ascending", limit: 1 } });
  await type("norm(acc) > 3 g", { shiftKey: true });
  await vi.waitFor(() => expect(asked.length).toBe(2));
  expect(asked[1]?.body).toMatchObject({ options: { before: START + 30, order: "descending" } });
  expect(stateOf(state).bar.peek().kind).toBe("condition");
});

it("marks a mistake where it is", async () => {
  const problem = { kind: "bad-expression", message: "Signal accc not found. (character 6)", hint: "Channels: acc." };
  open({
    [ROUTE]: Response.json(problem, { status: 422 }),
  });
  await type("norm(accc) > 3 g");
  await vi.waitFor(() => expect(said()).toContain("Signal accc not found."));
  const field = await input();
  expect([field.selectionStart, field.selectionEnd, field.getAttribute("aria-invalid")]).toEqual([5, 9, "true"]);
  expect(state.cursor.peek()).toBeUndefined();
});

it("a place that was looked for on one device moves nothing once another is shown", async () => {
  const figures = { begin: [START + 30], end: [START + 31], total: 1 };
  open({ [ROUTE]: [{ signal: "a", figures, units: {}, notes: [] }] });
  await type("a > 1");
  expect(said()).toContain("Searching");
  state.view.value = { ...state.view.peek(), device: "3" };
  await vi.waitFor(() => expect(said()).toBe(""));
  expect(state.actions.cursorTime()).toBeUndefined();
});
