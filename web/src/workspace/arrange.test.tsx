// @vitest-environment happy-dom
/** Panels of the whole page, arranged as a person does it: by keys, by the list, by dividers; undone and redone. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, it } from "vitest";
import { recorded } from "../testing/recorded";
import { openPage } from "../testing/live-page";
import { TEXT } from "../texts/workspace";
import { press } from "../testing/queries";

/** Those of the page without its extensions. */
const panels = () =>
  [...document.querySelectorAll<HTMLElement>("[data-panel]")]
    .map((one) => one.dataset["panel"] ?? "")
    .filter((id) => DEFAULT.includes(id));
const DEFAULT = ["attitude", "plots", "values", "health", "events"];

async function arranging() {
  const page = await openPage(recorded("xbus"));
  await waitFor(() => expect(panels()).toEqual(DEFAULT));
  press("w");
  await screen.findByRole("dialog", { name: TEXT.sheet });
  return page;
}

it("the default page has no tools of arranging, but the line between two tiles", async () => {
  await openPage(recorded("xbus"));
  await waitFor(() => expect(panels()).toEqual(DEFAULT));
  expect(screen.queryAllByRole("separator").map((one) => one.getAttribute("aria-label"))).toEqual([
    TEXT.heightOf("Attitude"),
  ]);
  expect(screen.queryByRole("dialog")).toBeNull();
});

it("panels are hidden, moved to another place and shown again, and all of it is undone and redone", async () => {
  const { app } = await arranging();
  fireEvent.change(screen.getByLabelText(TEXT.placeOf("Events")), { target: { value: "main" } });
  await waitFor(() => expect(panels()).toEqual(["attitude", "plots", "events", "values", "health"]));
  fireEvent.click(screen.getByLabelText(TEXT.moveUp("Events")));
  await waitFor(() => expect(panels().slice(0, 3)).toEqual(["attitude", "events", "plots"]));
  fireEvent.change(screen.getByLabelText(TEXT.placeOf("Values")), { target: { value: "hidden" } });
  await waitFor(() => expect(panels()).not.toContain("values"));
  fireEvent.click(screen.getByLabelText(TEXT.showPanel("Values")));
  await waitFor(() => expect(panels()).toEqual(["attitude", "events", "plots", "values", "health"]));
  fireEvent.click(screen.getByText(TEXT.defaultLayout));
  await waitFor(() => expect(panels()).toEqual(DEFAULT));
  press("z", { ctrlKey: true });
  await waitFor(() => expect(panels()).toEqual(["attitude", "events", "plots", "values", "health"]));
  for (let k = 0; k < 4; k += 1) press("z", { ctrlKey: true });
  await waitFor(() => expect(panels()).toEqual(DEFAULT));
  for (let k = 0; k < 4; k += 1) press("z", { ctrlKey: true, shiftKey: true });
  await waitFor(() => expect(panels()).toEqual(["attitude", "events", "plots", "values", "health"]));
  app.viewState.extraPlots.value = new Set(["Temperature"]);
  press("z", { ctrlKey: true });
  expect(app.viewState.extraPlots.value.size).toBe(0);
});

it("dividers are moved by the arrow keys within their limits, and Enter gives the default back", async () => {
  const { app } = await arranging();
  const divider = screen.getByRole("separator", { name: TEXT.sideWidth });
  expect(divider.getAttribute("aria-orientation")).toBe("vertical");
  fireEvent.keyDown(divider, { key: "Home" });
  await waitFor(() => expect(divider.getAttribute("aria-valuenow")).toBe("240"));
  expect(app.viewState.layout.value.sideWidth).toBe(240);
  fireEvent.keyDown(divider, { key: "Enter" });
  expect(app.viewState.layout.value.sideWidth).toBeUndefined();
  const height = screen.getByRole("separator", { name: TEXT.heightOf("Attitude") });
  const before = Number(height.getAttribute("aria-valuenow"));
  fireEvent.keyDown(height, { key: "ArrowDown" });
  expect(app.viewState.layout.value.panels["attitude"]).toEqual({ height: before + 10 });
  press("z", { ctrlKey: true });
  expect(app.viewState.layout.value.panels["attitude"]).toBeUndefined();
});

it("X maximises the panel with the focus, a double click that of the heading, and Esc gives the place back", async () => {
  await openPage(recorded("xbus"));
  await waitFor(() => expect(panels()).toEqual(DEFAULT));
  const maximised = () => document.querySelector(".maximised")?.getAttribute("data-panel");
  document.querySelector<HTMLElement>("#plots")?.focus();
  press("x");
  await waitFor(() => expect(maximised()).toBe("plots"));
  press("Escape");
  await waitFor(() => expect(maximised()).toBeUndefined());
  const heading = screen.getByRole("heading", { name: "Health" });
  fireEvent.dblClick(heading);
  await waitFor(() => expect(maximised()).toBe("health"));
  fireEvent.click(screen.getByText(TEXT.restore));
  await waitFor(() => expect(maximised()).toBeUndefined());
});

it("typing in a field is not a key of the workspace", async () => {
  await arranging();
  const field = document.createElement("input");
  document.body.append(field);
  fireEvent.keyDown(field, { key: "w" });
  expect(screen.queryByRole("dialog", { name: TEXT.sheet })).not.toBeNull();
  field.remove();
});

it("lanes are in one place only: below the plots, or in a panel of their own", async () => {
  await arranging();
  const below = () => document.querySelector<HTMLElement>("#plots .lanes");
  await waitFor(() => expect(below()?.hidden).toBe(false));
  fireEvent.click(screen.getByLabelText(TEXT.showPanel("Lanes")));
  await waitFor(() => expect(document.querySelector("[data-panel=lanes] .lane-names")).not.toBeNull());
  await waitFor(() => expect(below()?.hidden).toBe(true));
  fireEvent.change(screen.getByLabelText(TEXT.placeOf("Lanes")), { target: { value: "hidden" } });
  await waitFor(() => expect(below()?.hidden).toBe(false));
  expect(document.querySelector("[data-panel=lanes]")).toBeNull();
});
