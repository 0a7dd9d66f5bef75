// @vitest-environment happy-dom
/** The command palette: what is found by typing, and what Enter does with it. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import { openPage } from "../testing/live-page";
import { recorded } from "../testing/recorded";
import { TEXT } from "../texts/palette";

async function opened() {
  const page = await openPage(recorded("xbus"), {
    answers: { "GET /api/recordings": [], "GET /api/devices/1/forms": { settings: [], commands: [] } },
  });
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  fireEvent.keyDown(document.body, { key: "k", ctrlKey: true });
  const dialog = await screen.findByRole("dialog", { name: TEXT.title });
  const field = within(dialog).getByRole("searchbox");
  const lines = () => within(dialog).queryAllByRole("option");
  const type = async (text: string, first: string) => {
    fireEvent.input(field, { target: { value: text } });
    await waitFor(() => expect(lines()[0]?.textContent).toContain(first));
  };
  const enter = async () => {
    fireEvent.keyDown(field, { key: "Enter" });
    await waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
  };
  return { ...page, lines, type, enter, field };
}

test("a hidden panel is shown", async () => {
  const { app, type, enter } = await opened();
  await type("xy plot", "XY plot");
  await enter();
  expect(app.viewState.layout.value.panels["xy"]).toEqual({ shown: true });
  await waitFor(() => expect(document.querySelector("[data-panel=xy]")).not.toBeNull());
});

test("a signal is plotted by any of its names", async () => {
  const { app, type, enter, lines, field } = await opened();
  await type("gyro z", "Rate of turn");
  fireEvent.keyDown(field, { key: "ArrowDown" });
  await waitFor(() => expect(lines()[1]?.getAttribute("aria-selected")).toBe("true"));
  await enter();
  expect(app.viewState.customPlots.value.map(({ signals }) => signals.map(({ column }) => column))).toEqual([["z"]]);
});

test("an action does what its key does, and a page is gone to", async () => {
  const first = await opened();
  await first.type("signals", "signal");
  await first.type("all signals", "");
  fireEvent.input(first.field, { target: { value: "no such thing" } });
  expect(await screen.findByText(TEXT.nothingFound("no such thing"))).toBeTruthy();
  await first.type("configure page", "Configure");
  await first.enter();
  await waitFor(() => expect(location.hash).toMatch(/^#\/configure/));
});
