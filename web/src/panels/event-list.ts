/**
 * The events of the selected device and of the server, newest first; repeats are one line, sorts can be hidden, and pressing a line
 * shows its moment on the plots.
 */
import { clock } from "../ui/format/format";
import { el, throttle, messageNodes, type Panel } from "../ui/dom/dom";
import type { EventInfo } from "../wire/types";
import type { Deps, Sort } from "../page/context";
import { type EventGroup, eventGroups, SORTS } from "./event-groups";
import { registerPanel } from "./registry";
import { TEXT as PACKETS } from "../texts/packets";
import { TEXT } from "../texts/panels";

/** More are in the server's log. */
const MAX_EVENTS = 200;
/** Margin on either side of the event's interval, as part of its length. */
const MARGIN_SHARE = 0.5;

function mountEvents(host: HTMLElement, deps: Deps): Panel {
  const sort = deps.eventSort;
  const list = el("ol", { class: "event-list text-xs" });
  const none = el("p", { class: "foot-note dim" });
  const choice = el(
    "select",
    { "aria-label": TEXT.eventFilter },
    ...SORTS.map(({ name, title }) => el("option", { value: name }, title)),
  );
  choice.value = sort.peek();
  choice.addEventListener("change", () => (sort.value = choice.value as Sort));
  const label = el("label", { class: "select event-sort" }, choice);
  host.append(label, list, none);
  let shown: readonly EventInfo[] | undefined;
  let state = "";
  const due = throttle(4);
  return {
    update(now) {
      if (!due(now) || list.matches(":active")) return; // a line that is replaced while it is pressed is not clicked
      const events = deps.allEvents ?? deps.store.events.value;
      const device = deps.viewState.device.value;
      if (events === shown && state === `${device} ${sort.value}`) return;
      [shown, state] = [events, `${device} ${sort.value}`];
      const mine = events.filter((event) => event.device === device || event.device === "");
      const groups = eventGroups(mine, sort.value, MAX_EVENTS);
      const focused = list.contains(document.activeElement)
        ? document.activeElement?.getAttribute("data-key")
        : undefined;
      list.replaceChildren(...groups.map((group) => line(group, deps)));
      if (focused) list.querySelector<HTMLElement>(`[data-key="${focused}"]`)?.focus();
      none.textContent = mine.length === 0 ? TEXT.noEvents : TEXT.noMatchingEvents;
      none.hidden = groups.length > 0;
    },
    dispose() {
      for (const node of [label, list, none]) node.remove();
    },
  };
}

function line(group: EventGroup, deps: Deps): HTMLLIElement {
  const dot = { info: "off", warning: "warn", error: "bad" }[group.level];
  const word = TEXT.level[group.level];
  const mark = el(
    "span",
    {},
    el("span", { class: `dot ${dot}` }),
    el("span", { class: "visually-hidden" }, `${word}: `),
  );
  const button = el(
    "button",
    { type: "button", "data-key": String(group.key), title: titleOf(group) },
    mark,
    el("time", {}, clock(group.to)),
    el("span", {}, ...messageNodes(group.text)),
  );
  button.addEventListener("click", () => (deps.jump ? deps.jump(group) : show(group, deps)));
  const { device } = deps.viewState.view.peek();
  if (group.kind !== "reject" || device === undefined) return el("li", { "data-event": group.kind }, button);
  const bytes = el(
    "button",
    { type: "button", class: "btn small event-bytes", title: PACKETS.rejectedBytes },
    PACKETS.packet,
  );
  const { to: time } = group;
  const pin = (at: number): void => deps.viewState.actions.pinInView(at);
  bytes.addEventListener("click", () => deps.open.packet({ device, time, base: "arrival", kind: "reject", pin }));
  return el("li", { class: "with-bytes" }, button, bytes);
}

function titleOf({ from, to, count: n }: EventGroup): string {
  return n > 1 ? TEXT.showLastOfGroup(n, clock(from), clock(to)) : TEXT.showOnPlots;
}

/** Live: pause with the cursor on it; an interval longer than the window gets a window that holds it. */
function show({ t0, t1 }: EventGroup, deps: Deps): void {
  const { actions } = deps.viewState;
  const { span } = deps.viewState.view.peek();
  const room = MARGIN_SHARE * (t1 - t0);
  if (t1 - t0 > span * (1 - MARGIN_SHARE)) actions.select(t0 - room, t1 + room);
  else actions.centreAt((t0 + t1) / 2);
  actions.pin(t0);
}

registerPanel({
  id: "events",
  title: TEXT.events,
  note: TEXT.newestFirst,
  where: "below",
  order: 30,
  mount: mountEvents,
});
