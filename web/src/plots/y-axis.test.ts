// @vitest-environment happy-dom
/** The y axis: arithmetic of zooming, what is typed, and the control of a plot with its form. */
import { fireEvent, render, screen } from "@testing-library/preact";
import { h } from "preact";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Store } from "../data/store";
import { createViewState, type ViewState } from "../data/view-state";
import { giveSizes } from "../testing/live-page";
import { feed, recorded } from "../testing/recorded";
import type { Panel } from "../ui/dom/dom";
import { mountStack } from "./plot-stack";
import { isLogarithmic, logTicks, typedRange, shifted, zoomed } from "./y-axis";
import { YAxisDialog } from "./y-axis-dialog";

describe("the arithmetic", () => {
  it("zooms about the value under the pointer, and moves", () => {
    expect(zoomed([0, 10], 0.5, 0.2, false)).toEqual([1, 6]);
    expect(shifted([0, 10], 0.1, false)).toEqual([1, 11]);
    const [low, high] = zoomed([1, 100], 2, 0.5, true);
    expect([low, high]).toEqual([0.1, 1000].map((value) => expect.closeTo(value, 9)));
    expect(shifted([1, 100], 0.5, true)).toEqual([10, 1000].map((value) => expect.closeTo(value, 9)));
  });

  it("stops where numbers end", () => {
    expect(zoomed([1, 1 + 2e-6], 0.1, 0.5, false)).toEqual([1, 1 + 2e-6]);
    expect(zoomed([-1e14, 1e14], 100, 0.5, false)).toEqual([-1e14, 1e14]);
  });

  it("reads ranges with any minus and decimal sign", () => {
    expect(typedRange("−2,5", " 3e2")).toEqual([-2.5, 300]);
    expect([typedRange("", "3"), typedRange("a", "3"), typedRange("3", "3")]).toEqual(["number", "number", "order"]);
  });

  it("is logarithmic only while all values and the range are positive", () => {
    expect(isLogarithmic({ isLog: true }, 0.1)).toBe(true);
    expect(isLogarithmic({ isLog: true }, 0)).toBe(false);
    expect(isLogarithmic({ isLog: true, range: [-1, 5] }, 0.1)).toBe(false);
    expect(isLogarithmic({ range: [1, 5] }, 0.1)).toBe(false);
  });

  it("labels decades, and 2 and 5 where there are few", () => {
    expect(logTicks(-1, 1.1).map(({ value }) => value)).toEqual(
      [0.1, 0.2, 0.5, 1, 2, 5, 10].map((v) => expect.closeTo(v, 9)),
    );
    expect(logTicks(0, 12).map(({ value }) => Math.log10(value))).toEqual([0, 2, 4, 6, 8, 10, 12]);
  });
});

describe("the control", () => {
  let state: ViewState;
  let panel: Panel;
  let clock = 0;
  const draw = (): void => panel.update((clock += 1000));
  const gutter = (): HTMLButtonElement => document.querySelector<HTMLButtonElement>(".plot .y-gutter")!;
  const key = (): string => state.actions.plots()[0]!.key;

  beforeEach(() => {
    giveSizes();
    const store = new Store();
    const known = recorded("xbus");
    feed(store, known, known.texts);
    state = createViewState();
    const ring = store.channels.peek().find(({ info }) => info.name === "Acceleration")!.ring;
    state.view.value = { ...state.view.peek(), device: "1", live: false, end: ring.time(ring.length - 1), span: 5 };
    const host = document.createElement("div");
    document.body.append(host);
    panel = mountStack(host, { store, viewState: state, open: undefined } as never);
    draw();
  });
  afterEach(() => {
    panel.dispose();
  });

  it("fixes a range by wheel and keys, says so, and is automatic again by a double click", () => {
    expect(gutter().getAttribute("aria-label")).toBe("y axis of Acceleration, automatic");
    fireEvent.keyDown(gutter(), { key: "+" });
    const [low, high] = state.yAxes.peek().get(key())!.range!;
    draw();
    expect(gutter().textContent).toBe("fixed");
    expect(gutter().getAttribute("aria-label")).toContain("y axis of Acceleration, fixed from");
    fireEvent.keyDown(gutter(), { key: "ArrowUp" });
    const [above] = state.yAxes.peek().get(key())!.range!;
    expect(above).toBeCloseTo(low + 0.1 * (high - low), 6);
    draw();
    const wheel = new WheelEvent("wheel", { deltaY: 100, cancelable: true });
    Object.defineProperty(wheel, "clientY", { value: 40 }); // this DOM leaves it away
    fireEvent(gutter(), wheel);
    const [wide, wider] = state.yAxes.peek().get(key())!.range!;
    expect(wider - wide).toBeGreaterThan(high - low);
    fireEvent.dblClick(gutter());
    expect(state.yAxes.peek().size).toBe(0);
    draw();
    expect(gutter().textContent).toBe("");
  });

  it("takes a typed range, and says what is wrong with one", async () => {
    render(h(YAxisDialog, { viewState: state }));
    fireEvent.click(gutter(), { detail: 0 });
    const low = await screen.findByLabelText(/Minimum/);
    const high = screen.getByLabelText(/Maximum/);
    fireEvent.input(low, { target: { value: "5" } });
    fireEvent.input(high, { target: { value: "-5" } });
    fireEvent.click(screen.getByText("Fix range"));
    expect((await screen.findByRole("alert")).textContent).toBe("The minimum 5 must be below the maximum -5.");
    fireEvent.input(low, { target: { value: "−5" } });
    fireEvent.input(high, { target: { value: "5" } });
    fireEvent.click(screen.getByText("Fix range"));
    await vi.waitFor(() => expect(state.yAxes.peek().get(key())).toEqual({ range: [-5, 5] }));
    expect(state.yAxisForm.peek()).toBeUndefined();
  });
});
