// @vitest-environment happy-dom
/** The panel of status lanes. */
import { expect, test, vi } from "vitest";
import { Store } from "../data/store";
import { createViewState } from "../data/view-state";
import type { Deps } from "../page/context";
import { giveSizes } from "../testing/live-page";
import { feed, recorded } from "../testing/recorded";
import { mountLanes } from "./lanes-panel";

test("another theme is drawn with its own colours", async () => {
  giveSizes();
  const known = recorded("xbus");
  const store = new Store();
  feed(store, known, known.texts);
  const viewState = createViewState();
  viewState.view.value = { ...viewState.view.peek(), device: "1" };
  const host = document.body.appendChild(document.createElement("div"));
  const panel = mountLanes(host, { store, viewState } as unknown as Deps);
  panel.update(0);
  panel.update(1000);
  const colours = vi.spyOn(window, "getComputedStyle");
  panel.update(2000);
  expect(colours).not.toHaveBeenCalled();
  document.documentElement.dataset["theme"] = "light";
  await vi.waitFor(() => {
    panel.update(3000);
    expect(colours).toHaveBeenCalled();
  });
  panel.dispose();
});
