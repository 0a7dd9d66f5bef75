// @vitest-environment happy-dom
/** Two plot stacks in one document over the same samples: actions on one do not affect the other. */
import { fireEvent } from "@testing-library/preact";
import { afterEach, beforeEach, expect, test } from "vitest";
import { Store } from "../data/store";
import { createViewState, type ViewState } from "../data/view-state";
import { giveSizes } from "../testing/live-page";
import { feed, recorded } from "../testing/recorded";
import type { Panel } from "../ui/dom/dom";
import { mountStack, type StackDeps } from "./plot-stack";

interface View {
  readonly host: HTMLElement;
  readonly state: ViewState;
  readonly panel: Panel;
}

const known = recorded("xbus");
let views: readonly View[] = [];
let store = new Store();

function open(opens: Pick<StackDeps, "open"> = {}): View {
  const host = document.createElement("div");
  document.body.append(host);
  const state = createViewState();
  state.view.value = { ...state.view.peek(), device: "1" };
  return { host, state, panel: mountStack(host, { store, viewState: state, ...opens }) };
}

beforeEach(() => {
  giveSizes();
  store = new Store();
  feed(store, known, known.texts);
  views = [open(), open()];
  draw();
});
afterEach(() => {
  for (const { panel, host } of views) {
    panel.dispose();
    host.remove();
  }
});

let clock = 0;
/** Draws a frame of both a second later, past all rate limits. */
const draw = (): void => {
  clock += 1000;
  for (const { panel } of views) panel.update(clock);
};
const both = (): readonly [View, View] => {
  const [left, right] = views;
  if (left === undefined || right === undefined) throw new Error("not two views");
  return [left, right];
};
const titles = ({ host }: View): readonly string[] =>
  [...host.querySelectorAll(".legend b")].map(({ textContent }) => textContent ?? "");
const values = ({ host }: View): readonly string[] =>
  [...host.querySelectorAll(".legend .series-value")].map(({ textContent }) => textContent ?? "");
const pressed = ({ host }: View): readonly (string | null)[] =>
  [...host.querySelectorAll(".legend button")].map((button) => button.getAttribute("aria-pressed"));
const canvas = ({ host }: View): HTMLCanvasElement => {
  const found = host.querySelector<HTMLCanvasElement>(".plot canvas");
  if (found === null) throw new Error("no plot");
  return found;
};

/** Everything that a view shows, and its inputs. */
const shownOf = (one: View): unknown => ({
  titles: titles(one),
  values: values(one),
  pressed: pressed(one),
  view: one.state.view.value,
  cursor: one.state.cursor.value,
  measure: one.state.measure.value,
});

test("dragging and zooming one moves its window alone", () => {
  const [left, right] = both();
  const before = shownOf(right);
  expect(shownOf(left)).toEqual(before);
  const on = canvas(left);
  fireEvent.wheel(on, { clientX: 500, deltaY: -400 });
  expect(left.state.view.value.span).toBeLessThan(20);
  fireEvent.pointerDown(on, { clientX: 400, pointerId: 1, button: 0 });
  fireEvent.pointerMove(on, { clientX: 700, pointerId: 1 });
  fireEvent.pointerUp(on, { clientX: 700, pointerId: 1 });
  draw();
  expect(left.state.view.value.live).toBe(false);
  expect(shownOf(right)).toEqual(before);
});

test("a range selected on one is its window alone", () => {
  const [left, right] = both();
  const before = shownOf(right);
  left.state.actions.pause();
  draw();
  const { end, span } = left.state.view.value;
  const on = canvas(left);
  fireEvent.pointerDown(on, { clientX: 500, pointerId: 1, button: 0, shiftKey: true });
  fireEvent.pointerMove(on, { clientX: 600, pointerId: 1, shiftKey: true });
  fireEvent.pointerUp(on, { clientX: 600, pointerId: 1, shiftKey: true });
  draw();
  const selected = left.state.view.value;
  expect(selected.span).toBeGreaterThan(0.05 * span);
  expect(selected.span).toBeLessThan(0.2 * span);
  expect(selected.end).toBeLessThan(end);
  expect(shownOf(right)).toEqual(before);
});

test("a cursor on one is read there, and the other shows the newest sample", () => {
  const [left, right] = both();
  const before = values(right);
  expect(before[0]).toMatch(/\d/);
  const { ring } = store.channels.value.find(({ info }) => info.name === "Acceleration") ?? {};
  if (ring === undefined) throw new Error("no acceleration was recorded");
  left.state.actions.pause();
  const early = Math.floor(ring.length / 4);
  left.state.actions.pin(ring.time(early));
  left.state.actions.pinMeasure(ring.time(2 * early));
  draw();
  expect(values(left)[0]).toMatch(/^Δ/);
  expect(values(right)).toEqual(before);
  left.state.measure.value = undefined;
  draw();
  expect(Number(values(left)[0]?.replace("−", "-"))).toBeCloseTo(ring.value(0, early), 2);
  expect(values(right)).toEqual(before);
  expect(right.state.cursor.value).toBeUndefined();
});

test("series and quantities chosen on one are shown there alone", () => {
  const [left, right] = both();
  const before = shownOf(right);
  const [series] = left.host.querySelectorAll<HTMLElement>(".legend button");
  const more = left.host.querySelector<HTMLElement>(".more-quantities button");
  if (series === undefined || more === null) throw new Error("nothing to choose");
  fireEvent.click(series);
  fireEvent.click(more);
  draw();
  expect(pressed(left)[0]).toBe("false");
  expect(titles(left).length).toBe(titles(right).length + 1);
  expect(shownOf(right)).toEqual(before);
  const [other] = right.host.querySelectorAll<HTMLElement>(".legend button");
  if (other) fireEvent.click(other, { shiftKey: true });
  expect(pressed(right).slice(0, 3)).toEqual(["true", "false", "false"]);
  expect(pressed(left)[0]).toBe("false");
});

test("closing one does not change the other", () => {
  const [left, right] = both();
  left.panel.dispose();
  left.host.remove();
  views = [right];
  right.state.actions.setSpan(5);
  draw();
  expect(values(right)[0]).toMatch(/\d/);
  expect(right.state.view.value.span).toBe(5);
});
