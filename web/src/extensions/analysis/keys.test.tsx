// @vitest-environment happy-dom
/** Keys of analysis and of comparing. */
import { fireEvent, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { openPage } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";

test("one key compares the selected device with another one", async () => {
  const { app } = await openPage(recorded("xbus"));
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  fireEvent.keyDown(document.body, { key: "d" });
  await waitFor(() => expect(location.hash).toMatch(/^#\/recordings\?a=1&/));
  expect(app.viewState.view.value.device).toBe("1");
});

test("one key puts the analysis beside the plots, and takes it away again", async () => {
  vi.stubGlobal("innerWidth", 1440);
  const { app } = await openPage(recorded("xbus"));
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  fireEvent.keyDown(document.body, { key: "a" });
  await waitFor(() => expect(document.querySelector("[data-tile=analysis] .analysis")).not.toBeNull());
  const { layout } = app.viewState;
  expect(layout.value.tiles?.parts[1]).toEqual({ along: "row", parts: ["plots", "analysis"] });
  fireEvent.keyDown(document.body, { key: "a" });
  await waitFor(() => expect(document.querySelector("[data-tile=analysis]")).toBeNull());
});
