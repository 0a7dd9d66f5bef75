/** What happened? The newest events of the selected device and of the server, each with its time and a mark. */
import { clock } from "../ui/format";
import { el, every, type Panel } from "../ui/dom";
import type { EventInfo } from "../wire/types";
import { view } from "../data/view";
import type { Deps } from "./deps";

/** More are in the server's log; a side panel is read at a glance. */
const SHOWN = 25;

export function mountNews(host: HTMLElement, deps: Deps): Panel {
  const list = el("ol", { class: "news" });
  const none = el("p", { class: "foot-note dim" }, "Nothing has happened so far.");
  host.append(list, none);
  let shown: readonly EventInfo[] | undefined;
  let device: string | undefined;
  const due = every(4);
  return {
    update(now) {
      if (!due(now)) return;
      const events = deps.store.events.value;
      if (events === shown && device === view.value.device) return;
      shown = events;
      device = view.value.device;
      const mine = events.filter((event) => event.device === device || event.device === "").slice(-SHOWN).reverse();
      list.replaceChildren(...mine.map(line));
      none.hidden = mine.length > 0;
    },
    dispose() {
      list.remove();
      none.remove();
    },
  };
}

function line(event: EventInfo): HTMLLIElement {
  const dot = { info: "off", caution: "warn", fault: "bad" }[event.level];
  const word = { info: "note", caution: "caution", fault: "fault" }[event.level];
  const mark = el("span", {}, el("span", { class: `dot ${dot}` }), el("span", { class: "vh" }, `${word}: `));
  return el("li", {}, mark, el("time", {}, clock(event.time)), el("span", {}, event.text));
}
