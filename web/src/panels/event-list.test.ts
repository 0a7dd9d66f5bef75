// @vitest-environment happy-dom
/** The list of events while more of them come. */
import { signal } from "@preact/signals";
import { expect, test, vi } from "vitest";
import { Store } from "../data/store";
import { createViewState } from "../data/view-state";
import type { EventInfo } from "../wire/types";
import { eventInfo } from "../testing/fixtures";
import "./event-list";
import type { Deps } from "../page/context";
import { panelsAt } from "./registry";

const event = (seq: number, kind: EventInfo["kind"]): EventInfo => eventInfo({ seq, kind, time: seq, text: kind });

test("a line stays while it is pressed, so that it is clicked", () => {
  const viewState = createViewState();
  viewState.view.value = { ...viewState.view.peek(), device: "1" };
  const events = signal<readonly EventInfo[]>([event(1, "gap")]);
  const store = Object.assign(new Store(), { events });
  const deps = { store, viewState, eventSort: signal("all") } as unknown as Deps;
  const host = document.createElement("div");
  const panel = panelsAt("below", deps)
    .find(({ id }) => id === "events")
    ?.mount(host, deps, null);
  panel?.update(0);
  const list = host.querySelector("ol") as HTMLElement;
  const line = list.querySelector("button");
  const pressed = vi.spyOn(list, "matches").mockReturnValue(true);
  events.value = [...events.value, event(2, "clock")];
  panel?.update(1000);
  expect(list.querySelector("button")).toBe(line);
  pressed.mockReturnValue(false);
  panel?.update(2000);
  expect(list.querySelectorAll("button")).toHaveLength(2);
  panel?.dispose();
});
