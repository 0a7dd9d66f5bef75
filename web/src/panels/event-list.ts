/**
 * What happened: the events of the selected device and of the server, newest first; what repeats is one line, sorts can be left out,
 * and a press on a line shows its moment on the plots.
 */
import { signal } from "@preact/signals";
import { centreAt, pin, select } from "../data/view-actions";
import { view } from "../data/view-state";
import { clock, count } from "../ui/format";
import { el, every, messageNodes, type Panel } from "../ui/dom";
import type { EventInfo } from "../wire/types";
import type { Deps } from "./panel-context";
import { type EventGroup, groupsOf, type Sort, SORTS } from "./event-groups";

/** More are in the server's log. */
const SHOWN = 200;
/** Shown on either side of what happened, as part of its length. */
const ROOM = 0.5;

/** What is listed; the same on every page. */
const sort = signal<Sort>("all");

export function mountNews(host: HTMLElement, deps: Deps): Panel {
  const list = el("ol", { class: "news" });
  const none = el("p", { class: "foot-note dim" });
  const choice = el("select", { "aria-label": "Which events" }, ...SORTS.map(({ name, title }) => el("option", { value: name }, title)));
  choice.value = sort.peek();
  choice.addEventListener("change", () => (sort.value = choice.value as Sort));
  const label = el("label", { class: "select newsort" }, choice);
  host.append(label, list, none);
  let shown: readonly EventInfo[] | undefined;
  let state = "";
  const due = every(4);
  return {
    update(now) {
      if (!due(now)) return;
      const events = deps.allEvents ?? deps.store.events.value;
      const { device } = view.value;
      if (events === shown && state === `${device} ${sort.value}`) return;
      [shown, state] = [events, `${device} ${sort.value}`];
      const mine = events.filter((event) => event.device === device || event.device === "");
      const groups = groupsOf(mine, sort.value, SHOWN);
      const focused = list.contains(document.activeElement) ? document.activeElement?.getAttribute("data-key") : undefined;
      list.replaceChildren(...groups.map((group) => line(group, deps)));
      if (focused) list.querySelector<HTMLElement>(`[data-key="${focused}"]`)?.focus();
      none.textContent = mine.length === 0 ? "Nothing has happened so far." : "Nothing of that sort has happened.";
      none.hidden = groups.length > 0;
    },
    dispose() {
      for (const node of [label, list, none]) node.remove();
    },
  };
}

function line(group: EventGroup, deps: Deps): HTMLLIElement {
  const dot = { info: "off", caution: "warn", fault: "bad" }[group.level];
  const word = { info: "note", caution: "caution", fault: "fault" }[group.level];
  const mark = el("span", {}, el("span", { class: `dot ${dot}` }), el("span", { class: "vh" }, `${word}: `));
  const button = el("button", { type: "button", "data-key": String(group.key), title: titleOf(group) }, mark, el("time", {}, clock(group.to)), el("span", {}, ...messageNodes(group.text)));
  button.addEventListener("click", () => (deps.jump ?? show)(group));
  return el("li", {}, button);
}

function titleOf({ from, to, count: n }: EventGroup): string {
  return n > 1 ? `${count(n, "time")}, ${clock(from)} to ${clock(to)} UTC. Show the last on the plots.` : "Show it on the plots";
}

/** Live: stop there, with the cursor on it; what is longer than the window gets a window that holds it. */
function show({ t0, t1 }: EventGroup): void {
  const { span } = view.peek();
  const room = ROOM * (t1 - t0);
  if (t1 - t0 > span * (1 - ROOM)) select(t0 - room, t1 + room);
  else centreAt((t0 + t1) / 2);
  pin(t0);
}
