// @vitest-environment happy-dom
/** Extensions of the page: whichever there are, it opens; a mistaken one is refused. */
import { waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { allExtensions, registerExtension } from "./extension";
import { openPage } from "../testing/live-page";
import { recorded } from "../testing/recorded";

test("the page opens without an error", async () => {
  const errors = [vi.spyOn(console, "error"), vi.spyOn(console, "warn")];
  await openPage(recorded("xbus"));
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  for (const spy of errors) expect(spy).not.toHaveBeenCalled();
});

test("a name is taken once", () => {
  registerExtension({ name: "trial" });
  expect(() => registerExtension({ name: "trial" })).toThrow("two extensions");
});

test("dialogs are named after their extension, and panels have names of their own", () => {
  const all = allExtensions();
  const foreign = all.flatMap(({ name, dialogs = [] }) =>
    dialogs.filter(({ overlay }) => !overlay.startsWith(`${name}/`)),
  );
  expect(all.flatMap(({ dialogs = [] }) => dialogs)).not.toEqual([]);
  expect(foreign).toEqual([]);
  const panels = all.flatMap(({ panels: own = [] }) => own.map(({ id }) => id));
  expect(new Set(panels).size).toBe(panels.length);
});
