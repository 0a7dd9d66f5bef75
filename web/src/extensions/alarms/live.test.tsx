// @vitest-environment happy-dom
/** Alarms on signals: from the tree of signals, and from the legend of a plot. */
import { fireEvent, screen } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { Store } from "../../data/store";
import { createViewState } from "../../data/view-state";
import { mountStack } from "../../plots/plot-stack";
import { giveSizes, openPage } from "../../testing/live-page";
import { feed, recorded } from "../../testing/recorded";
import { draftOf } from "./list";
import type { AlarmDraft } from "./states";

const known = recorded("xbus");

test("an alarm on a signal begins with the signal and a limit", async () => {
  const opened = await openPage(known, { answers: { "POST /api/alarms/check": {} } });
  await screen.findByRole("button", { name: "All signals…" });
  fireEvent.keyDown(document.body, { key: "s", code: "KeyS" });
  const row = (await screen.findAllByRole("treeitem")).find((one) => one.dataset["row"] === "1/Acceleration");
  fireEvent.click(row as HTMLElement);
  fireEvent.click(await screen.findByRole("button", { name: "Alarm when…" }));
  const condition = await screen.findByLabelText<HTMLInputElement>("Condition");
  expect(condition.value).toMatch(/^norm\(Acceleration\) > [\d.]+ m\/s²$/);
  expect(draftOf(opened.app).device?.id).toBe("1");
});

test("the menu of a series in the legend opens an alarm on it, with the value at the cursor as its limit", () => {
  giveSizes();
  const [store, viewState, dialog] = [new Store(), createViewState(), vi.fn()];
  feed(store, known, known.texts);
  viewState.view.value = { ...viewState.view.peek(), device: "1" };
  const host = document.createElement("div");
  document.body.append(host);
  const stack = mountStack(host, { store, viewState, open: { signals: vi.fn(), dialog } });
  stack.update(1000);
  const x = host.querySelector<HTMLElement>(".legend .series");
  expect(x?.title).toContain("alarm when…");
  fireEvent.contextMenu(x as HTMLElement);
  const [name, draft] = dialog.mock.calls.at(-1) as [string, AlarmDraft];
  expect(name).toBe("alarms/dialog");
  expect(draft.expression).toMatch(/^"?[\w .]+"?\.x [<>] -?[\d.e-]+ \S+$/);
  expect(draft.device?.id).toBe("1");
  stack.dispose();
  host.remove();
});
