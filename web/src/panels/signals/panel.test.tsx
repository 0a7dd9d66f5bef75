// @vitest-environment happy-dom
/** The tree of signals on the page: search, keys, plots for a signal, and taking it off again. */
import { createEvent, fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import { type Opened, openPage } from "../../testing/live-page";
import { type Answers, recorded } from "../../testing/recorded";

const known = recorded("xbus");
const rows = (): readonly HTMLElement[] => screen.getAllByRole("treeitem");
const names = (): readonly string[] => rows().map((row) => row.getAttribute("data-row") ?? "");
const signals = ({ app }: Opened) => app.viewState.customPlots.value.map((plot) => plot.signals.map((s) => s.column));

function rowNamed(name: string): HTMLElement {
  const found = rows().find((row) => row.getAttribute("data-row") === name);
  if (!found) throw new Error(`no row ${name}: ${names().join("; ")}`);
  return found;
}

async function openTree(answers: Answers = {}): Promise<Opened> {
  const opened = await openPage(known, { answers });
  await screen.findByRole("button", { name: "All signals…" });
  fireEvent.keyDown(document.body, { key: "s", code: "KeyS" });
  const search = await screen.findByRole("searchbox");
  await waitFor(() => expect(document.activeElement).toBe(search));
  return opened;
}

test("a key opens the tree with the channels of the selected device, and Escape closes it", async () => {
  await openTree();
  expect(names()).toContain("1/Acceleration");
  fireEvent.keyDown(screen.getByRole("searchbox"), { key: "Escape" });
  await waitFor(() => expect(screen.queryByRole("tree")).toBeNull());
});

test("a search leaves what matches, by name, column and unit", async () => {
  await openTree();
  fireEvent.input(screen.getByRole("searchbox"), { target: { value: "acceleration y m/s²" } });
  await waitFor(() => expect(names()).toContain("1/Acceleration/y"));
  expect(names()).not.toContain("1/Acceleration/x");
  fireEvent.input(screen.getByRole("searchbox"), { target: { value: "no such thing" } });
  expect(await screen.findByText("No signal matches “no such thing”.")).toBeTruthy();
});

test("keys unfold a channel, choose a column and plot it; the pressed plot takes it off", async () => {
  const opened = await openTree();
  const row = rowNamed("1/Acceleration");
  row.focus();
  fireEvent.keyDown(row, { key: "ArrowRight" });
  await waitFor(() => expect(names()).toContain("1/Acceleration/x"));
  fireEvent.keyDown(row, { key: "ArrowDown" });
  await waitFor(() => expect(document.activeElement?.getAttribute("data-row")).toBe("1/Acceleration/x"));
  fireEvent.keyDown(document.activeElement as Element, { key: "Enter" });
  const targets = screen.getByRole("group", { name: "Plot Acceleration x on:" });
  expect(document.activeElement).toBe(within(targets).getByRole("button", { name: "New plot" }));
  fireEvent.click(document.activeElement as Element);
  await waitFor(() => expect(signals(opened)).toEqual([["x"]]));
  expect(await screen.findByText("On a new plot: Acceleration x.")).toBeTruthy();
  const plots = await within(targets).findAllByRole("button", { name: "Acceleration", pressed: true });
  fireEvent.click(plots.at(-1) as Element);
  await waitFor(() => expect(signals(opened)).toEqual([]));
});

test("several signals go onto a plot together: chosen by Ctrl, Shift or Space, or as a search has found them", async () => {
  const opened = await openTree();
  fireEvent.click(within(rowNamed("1/Acceleration")).getByRole("button", { name: "Unfold Acceleration" }));
  await waitFor(() => expect(names()).toContain("1/Acceleration/x"));
  fireEvent.click(rowNamed("1/Acceleration/x"));
  fireEvent.click(rowNamed("1/Acceleration/z"), { ctrlKey: true });
  fireEvent.click(await screen.findByRole("button", { name: "New plot" }));
  await waitFor(() => expect(signals(opened)).toEqual([["x", "z"]]));
  expect(screen.getByText("On a new plot: 2 signals.")).toBeTruthy();
  fireEvent.click(rowNamed("1/Acceleration/x"));
  rowNamed("1/Acceleration/x").focus();
  fireEvent.keyDown(rowNamed("1/Acceleration/x"), { key: "ArrowDown", shiftKey: true });
  await waitFor(() => expect(rows().filter((row) => row.getAttribute("aria-selected") === "true")).toHaveLength(2));
  fireEvent.keyDown(rowNamed("1/Acceleration/y"), { key: " " });
  await waitFor(() => expect(rows().filter((row) => row.getAttribute("aria-selected") === "true")).toHaveLength(1));
  const search = screen.getByRole("searchbox");
  fireEvent.input(search, { target: { value: "pqr[2]" } });
  await waitFor(() => expect(names().at(-1)).toBe("1/RateOfTurn/z"));
  fireEvent.keyDown(search, { key: "Enter" });
  await waitFor(() => expect(signals(opened)).toEqual([["x", "z"], ["z"]]));
});

test("a second unit gets the right axis of a plot, and a third one is refused with a sentence", async () => {
  const opened = await openTree();
  fireEvent.click(rowNamed("1/Acceleration"));
  fireEvent.click(await screen.findByRole("button", { name: "Rate of turn", pressed: false }));
  await waitFor(() => expect(signals(opened)).toEqual([["x", "y", "z"]]));
  const right = await screen.findByRole("button", { name: "y axis of Rate of turn, right, automatic" });
  expect(right.closest(".plot")?.getAttribute("data-key")).toBe("RateOfTurn");
  expect(right.closest(".plot")?.querySelector(".legend")?.textContent).toContain("m/s²");
  fireEvent.click(rowNamed("1/MagneticField"));
  fireEvent.click(await screen.findByRole("button", { name: "Rate of turn", pressed: false }));
  expect(await screen.findByText(/at most two units: Rate of turn has °\/s and m\/s², this signal is in/)).toBeTruthy();
  expect(signals(opened)).toEqual([["x", "y", "z"]]);
});

test("a channel dropped under the plots makes a new plot, which its own button removes", async () => {
  const opened = await openTree();
  const row = rowNamed("1/Acceleration");
  const data = new Map([["application/x-imuscope-signal", row.getAttribute("data-row") ?? ""]]);
  const dataTransfer = { getData: (type: string) => data.get(type) ?? "", types: [...data.keys()] };
  const stack = document.querySelector(".stack") as Element;
  fireEvent(stack, createEvent.dragOver(stack, { dataTransfer }));
  expect(stack.classList.contains("drop-target")).toBe(true);
  fireEvent(stack, createEvent.drop(stack, { dataTransfer }));
  await waitFor(() => expect(signals(opened)).toEqual([["x", "y", "z"]]));
  fireEvent.click(await screen.findByRole("button", { name: "Remove the plot Acceleration" }));
  await waitFor(() => expect(signals(opened)).toEqual([]));
});
