// @vitest-environment happy-dom
/** Two recordings open in one document: each has its own position, window, cursors, series, markers and dialogs. */
import { act, fireEvent, render, waitFor, within } from "@testing-library/preact";
import { beforeEach, expect, test, vi } from "vitest";
import { Store } from "../../data/store";
import { createViewState } from "../../data/view-state";
import { ReplayController } from "../../recordings/replay-controller";
import { giveSizes, newApp, startOver } from "../../testing/live-page";
import { answering, type Asked } from "../../testing/recorded";
import { detailOf, recordingAnswers } from "../../testing/recordings";
import type { App } from "../../page/context";
import { openRecording } from "./open-recording";
import { ReplayPage } from "./replay-page";

interface Side {
  readonly app: App;
  readonly replay: ReplayController;
  readonly element: HTMLElement;
  readonly in: ReturnType<typeof within>;
}

let asked: readonly Asked[] = [];

function open(id: string, store: Store): Side {
  const app = newApp(store);
  const replay = new ReplayController(detailOf(id), { hide: [], show: [], panels: [] }, createViewState(app.viewState));
  const { container } = render(<ReplayPage recording={openRecording(replay, app)} />);
  const element = container.firstElementChild;
  if (!(element instanceof HTMLElement)) throw new Error("nothing is open");
  return { app, replay, element, in: within(element) };
}

beforeEach(() => {
  startOver("#/recordings/yard");
  vi.restoreAllMocks();
  giveSizes();
  asked = answering(recordingAnswers());
});

async function both(): Promise<readonly [Side, Side]> {
  const store = new Store();
  const sides = [open("yard", store), open("harbour", store)] as const;
  for (const side of sides) await waitFor(() => expect(value(side)).toMatch(/\d/));
  return sides;
}

const text = ({ element }: Side, selector: string): string => element.querySelector(selector)?.textContent ?? "";
const value = (side: Side): string => text(side, ".plot .legend .series-value");
const clock = (side: Side): string => text(side, ".transport .now");
const markers = ({ in: side }: Side): readonly (string | null)[] =>
  within(side.getByRole("region", { name: "Markers" }))
    .getAllByRole("listitem")
    .map(({ textContent }) => textContent);
const pressed = ({ element }: Side): readonly (string | null)[] =>
  [...element.querySelectorAll(".legend button")].map((button) => button.getAttribute("aria-pressed"));

/** Everything of one side that the other must not change. */
const stateOf = (side: Side): unknown => ({
  place: side.replay.place(),
  playing: side.replay.playing.value,
  speed: side.replay.speed.value,
  clock: clock(side),
  value: value(side),
  markers: markers(side),
  pressed: pressed(side),
  form: side.element.querySelector("form") !== null,
  loop: text(side, ".transport .loop"),
});

test("moving, cutting and reading one does not affect the other", async () => {
  const [left, right] = await both();
  await waitFor(() => expect(clock(right)).toMatch(/^00:00/));
  const before = stateOf(right);
  const shown = value(left);
  left.replay.seek(left.replay.bounds.first + 2);
  left.replay.viewState.actions.select(left.replay.bounds.first + 1, left.replay.bounds.first + 3);
  left.replay.viewState.actions.pinMeasure(left.replay.bounds.first + 2.5);
  fireEvent.click(left.in.getByRole("button", { name: /^Loop/ }));
  const [series] = left.element.querySelectorAll(".legend button");
  if (series) fireEvent.click(series);
  await waitFor(() => expect(clock(left)).toMatch(/^00:02\.000/));
  await waitFor(() => expect(value(left)).not.toBe(shown));
  await waitFor(() => expect(text(left, ".transport .loop")).toMatch(/00:01.*00:03/));
  expect(pressed(left)[0]).toBe("false");
  expect(left.replay.place()).toMatchObject({ cursor: left.replay.bounds.first + 2, hide: [expect.any(String)] });
  expect(stateOf(right)).toEqual(before);
});

test("each plays independently, at its own speed", async () => {
  const [left, right] = await both();
  const start = right.replay.head;
  fireEvent.change(left.in.getByRole("combobox", { name: "Speed" }), { target: { value: "5" } });
  fireEvent.click(left.in.getByRole("button", { name: "Play" }));
  await waitFor(() => expect(left.replay.head).toBeGreaterThan(left.replay.bounds.first + 0.5));
  expect(right.replay.head).toBe(start);
  expect(right.in.getByRole("button", { name: "Play" })).toBeTruthy();
  fireEvent.click(right.in.getByRole("button", { name: "Play" }));
  await waitFor(() => expect(right.replay.head).toBeGreaterThan(start + 0.2));
  expect(left.replay.head).toBeLessThan(start); // an hour before
  fireEvent.click(left.in.getByRole("button", { name: "Pause" }));
  expect([left.replay.playing.value, right.replay.playing.value]).toEqual([false, true]);
});

test("a marker is set in one of them", async () => {
  const [left, right] = await both();
  const before = stateOf(left);
  right.replay.seek(right.replay.bounds.first + 1.5);
  fireEvent.click(right.in.getByRole("button", { name: "Marker" }));
  const field = await right.in.findByPlaceholderText(/^Marker at/);
  expect(left.in.queryByPlaceholderText(/^Marker at/)).toBeNull();
  fireEvent.input(field, { target: { value: "second look" } });
  fireEvent.submit(field.closest("form") as HTMLFormElement);
  await waitFor(() => expect(markers(right).length).toBe(2));
  expect(asked.filter(({ method }) => method === "POST").map(({ path }) => path)).toEqual([
    "/api/recordings/harbour/markers",
  ]);
  expect(stateOf(left)).toEqual(before);
});

test("keys act on the focused one", async () => {
  const [left, right] = await both();
  const plots = right.element.querySelector(".stack");
  if (plots === null) throw new Error("no plots");
  fireEvent.keyDown(plots, { key: "End" });
  expect(right.replay.head).toBe(right.replay.bounds.last);
  expect(left.replay.head).toBe(left.replay.bounds.first);
  fireEvent.keyDown(left.element.querySelector(".stack") ?? left.element, { key: " ", code: "Space" });
  expect([left.replay.playing.value, right.replay.playing.value]).toEqual([true, false]);
});

test("a dialog over one is not opened over the other", async () => {
  const [left, right] = await both();
  await act(() => {
    left.app.overlay.value = "help";
    left.app.sheet.value = "rail";
    left.app.folded.value = true;
  });
  expect(left.element.querySelector("dialog")).not.toBeNull();
  expect(left.element.className).toContain("folded");
  expect(right.element.querySelector("dialog, .rail.open")).toBeNull();
  expect(right.element.className).not.toContain("folded");
});

test("listed events and the last problem belong to one page", async () => {
  const [left, right] = await both();
  const sort = ({ element }: Side): HTMLSelectElement =>
    element.querySelector(".event-sort select") as HTMLSelectElement;
  const other = [...sort(left).options].at(-1)?.value ?? "";
  fireEvent.change(sort(left), { target: { value: other } });
  await act(() => {
    left.app.problem.value = { kind: "x", message: "The disk is full.", hint: "", status: 0 };
  });
  expect(left.app.eventSort.value).toBe(other);
  expect(right.app.eventSort.value).toBe("all");
  expect(left.element.textContent).toContain("The disk is full.");
  expect(right.element.textContent).not.toContain("The disk is full.");
});
