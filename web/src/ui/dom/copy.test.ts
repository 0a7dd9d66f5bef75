// @vitest-environment happy-dom
import { expect, it, vi } from "vitest";
import { copyText } from "./copy";

/** A page over plain HTTP: no clipboard, but a command that copies what is selected. */
function insecure(allowed: boolean): { readonly copied: () => string; readonly within: () => string | undefined } {
  let copied = "";
  let within: string | undefined;
  vi.stubGlobal("navigator", {});
  document.execCommand = () => {
    const field = document.querySelector("textarea");
    within = field?.parentElement?.tagName;
    copied = field?.value ?? "";
    return allowed;
  };
  return { copied: () => copied, within: () => within };
}

it("copies by a selection where there is no clipboard, and leaves nothing behind", async () => {
  const page = insecure(true);
  expect(await copyText("FA FF 3E")).toBe(true);
  expect([page.copied(), page.within(), document.querySelector("textarea")]).toEqual(["FA FF 3E", "BODY", null]);
});

it("selects within the open dialog, and gives the focus back", async () => {
  const page = insecure(true);
  const dialog = document.createElement("dialog");
  const button = document.createElement("button");
  dialog.append(button);
  document.body.append(dialog);
  dialog.showModal();
  button.focus();
  await copyText("1.25");
  expect([page.copied(), page.within()]).toEqual(["1.25", "DIALOG"]);
  expect(document.activeElement).toBe(button);
});

it("tells that the browser does not let it", async () => {
  insecure(false);
  expect(await copyText("1.25")).toBe(false);
});
