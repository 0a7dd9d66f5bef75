// @vitest-environment happy-dom
/** Workspaces of a server: the default of a family, and a file. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, it, vi } from "vitest";
import { openPage } from "../../testing/live-page";
import { begun, keyOf } from "../../testing/family-workspace";
import { recorded } from "../../testing/recorded";
import { sessionOf } from "../../workspace/session";
import { TEXT as WORKSPACE } from "../../texts/workspace";
import { currentOf } from "./stored";
import { TEXT } from "./texts";

const KEY = keyOf("xbus");

it("a page opens with the workspace of the device's family", async () => {
  const { app, plots } = await begun("xbus");
  await waitFor(() => expect(plots()).toEqual(["Pressure"]));
  expect(currentOf(sessionOf(app, app.viewState)).value?.name).toBe("race");
  expect(sessionOf(app, app.viewState).history.canUndo).toBe(false);
  expect(localStorage.getItem(KEY)).toBeNull(); // nobody changed anything
});

it("a file that is refused takes the words of an earlier success away", async () => {
  const workspace = { name: "Bench", revision: "1", workspace: {} };
  const answers = {
    "GET /api/workspaces": { workspaces: [{ name: "Bench", revision: "1" }], defaults: {} },
    "GET /api/workspaces/Bench": workspace,
  };
  await openPage(recorded("xbus"), { answers });
  fireEvent.keyDown(document.body, { key: "w" });
  await screen.findByRole("option", { name: "Bench" });
  fireEvent.change(screen.getByLabelText(TEXT.workspace), { target: { value: "Bench" } });
  await screen.findByText(TEXT.opened("Bench"));
  const input = document.querySelector<HTMLInputElement>(".stored input[type=file]");
  const files = [new File(["no workspace"], "bad.json")];
  if (input) fireEvent.change(input, { target: { files } });
  await screen.findByText(WORKSPACE.notAWorkspace);
  expect(screen.queryByText(TEXT.opened("Bench"))).toBeNull();
});

it("of two workspaces that are chosen quickly the last is shown, whichever comes last", async () => {
  const listed = ["One", "Two"].map((name) => ({ name, revision: "1" }));
  const { app } = await openPage(recorded("xbus"), {
    answers: { "GET /api/workspaces": { workspaces: listed, defaults: {} } },
  });
  fireEvent.keyDown(document.body, { key: "w" });
  await screen.findByRole("option", { name: "Two" });
  const answered = globalThis.fetch;
  const held = new Map<string, () => void>();
  vi.stubGlobal("fetch", (address: string, init: RequestInit) => {
    const name = /workspaces\/(\w+)$/.exec(address)?.[1];
    if (name === undefined) return answered(address, init);
    const body = { name, revision: "1", workspace: {} };
    return new Promise((resolve) => held.set(name, () => resolve(Response.json(body))));
  });
  const choose = (name: string): void =>
    void fireEvent.change(screen.getByLabelText(TEXT.workspace), { target: { value: name } });
  choose("One");
  choose("Two");
  await waitFor(() => expect(held.size).toBe(2));
  held.get("Two")?.();
  await screen.findByText(TEXT.opened("Two"));
  held.get("One")?.();
  await new Promise((resolve) => setTimeout(resolve, 50));
  expect(currentOf(sessionOf(app, app.viewState)).value?.name).toBe("Two");
  expect(screen.getByText(TEXT.opened("Two"))).toBeTruthy();
});

/** Regression: a longer name was cut without a word. */
it("a name that is cut at its limit says so", async () => {
  await openPage(recorded("xbus"), { answers: { "GET /api/workspaces": { workspaces: [], defaults: {} } } });
  fireEvent.keyDown(document.body, { key: "w" });
  const name = await screen.findByLabelText(TEXT.newName);
  fireEvent.input(name, { target: { value: "Bench" } });
  expect(screen.queryByText(TEXT.longest(80))).toBeNull();
  fireEvent.input(name, { target: { value: "B".repeat(80) } });
  await screen.findByText(TEXT.longest(80));
});
