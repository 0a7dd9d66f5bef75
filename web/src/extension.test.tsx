// @vitest-environment happy-dom
/** Extensions of the page: whichever there are, it opens; a mistaken one is refused. */
import { waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { registerExtension } from "./extension";
import { openPage } from "./testing/live-page";
import { recorded } from "./testing/recorded";

test("the page opens without an error", async () => {
  const errors = [vi.spyOn(console, "error"), vi.spyOn(console, "warn")];
  await openPage(recorded("xbus"));
  await waitFor(() => expect(document.querySelector("[data-numeral]")).not.toBeNull());
  for (const spy of errors) expect(spy).not.toHaveBeenCalled();
});

test("a dialog is named after its extension, and a name is taken once", () => {
  const dialog = { overlay: "elsewhere/dialog", View: () => null } as const;
  expect(() => registerExtension({ name: "trial", dialogs: [dialog] })).toThrow('must begin with "trial/"');
  registerExtension({ name: "trial" });
  expect(() => registerExtension({ name: "trial" })).toThrow("two extensions");
});
