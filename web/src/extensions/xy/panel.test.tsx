// @vitest-environment happy-dom
/** The XY plot on the page: shown from the workspace, its signals chosen, the cursor put on a sample, and pairs from the server. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import { type Opened, openPage } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";
import { DEFAULT_LAYOUT, show } from "../../data/layout";

const known = recorded("xbus");

async function openXy(): Promise<Opened & { readonly panel: HTMLElement }> {
  const opened = await openPage(known);
  const { layout } = opened.app.viewState;
  layout.value = show(DEFAULT_LAYOUT, { id: "xy", where: "main", optional: true }, true);
  const panel = await screen.findByRole("region", { name: "XY plot" });
  await within(panel).findByRole("combobox", { name: "x" });
  const held = await waitFor(() => opened.app.viewState.actions.bounds() ?? Promise.reject(new Error("no samples")));
  opened.app.viewState.actions.select(held.first, held.last);
  return { ...opened, panel };
}

const textOf = (select: HTMLElement): string | undefined =>
  (select as HTMLSelectElement).selectedOptions[0]?.textContent ?? undefined;

test("the magnetic field y over x is shown first, of the same sample times", async () => {
  const { panel } = await openXy();
  expect(textOf(within(panel).getByRole("combobox", { name: "x" }))).toBe("Magnetic field x");
  expect(textOf(within(panel).getByRole("combobox", { name: "y" }))).toBe("Magnetic field y");
  expect(await within(panel).findByText(/^[\d\s]+ samples · same sample times$/)).toBeTruthy();
  expect(within(panel).getByRole("img", { name: /^Magnetic field y over Magnetic field x, / })).toBeTruthy();
});

test("another signal is chosen, paired at the times of the faster one, and swapped", async () => {
  const { app, panel } = await openXy();
  const x = within(panel).getByRole("combobox", { name: "x" }) as HTMLSelectElement;
  const other = [...x.options].find((option) => option.textContent === "Acceleration z");
  fireEvent.change(x, { target: { value: other?.value } });
  await waitFor(() => expect(app.viewState.xy.value.x).toEqual(["Acceleration", "z"]));
  fireEvent.click(await within(panel).findByRole("button", { name: "Nearest" }));
  await waitFor(() => expect(app.viewState.xy.value.pairing).toBe("nearest"));
  expect(within(panel).queryByRole("button", { name: "Equal scale" })).toBeNull(); // m/s² and another unit
  fireEvent.click(within(panel).getByRole("button", { name: "Swap x and y" }));
  await waitFor(() => expect(app.viewState.xy.value.y).toEqual(["Acceleration", "z"]));
});

test("trail, points and equal scale are kept in the view, and undone by a second press", async () => {
  const { app, panel } = await openXy();
  for (const name of ["Trail", "Points", "Equal scale"]) fireEvent.click(within(panel).getByRole("button", { name }));
  await waitFor(() => expect(app.viewState.xy.value).toEqual({ colour: "trail", draw: "points", isEqual: true }));
  fireEvent.click(within(panel).getByRole("button", { name: "Equal scale" }));
  await waitFor(() => expect(app.viewState.xy.value.isEqual).toBeUndefined());
});

test("arrow keys on the picture put the cursor on samples, and its values are read", async () => {
  const { app, panel } = await openXy();
  const picture = await within(panel).findByRole("img");
  await within(panel).findByText(/samples · same/);
  fireEvent.keyDown(picture, { key: "ArrowLeft" });
  await waitFor(() => expect(app.viewState.cursor.value?.kind).toBe("pinned"));
  const first = app.viewState.actions.cursorTime() ?? NaN;
  fireEvent.keyDown(picture, { key: "ArrowLeft" });
  await waitFor(() => expect(app.viewState.actions.cursorTime()).toBeLessThan(first));
  expect(await within(panel).findByText(/^x [−\d.]+ .*y [−\d.]+ /)).toBeTruthy();
});
