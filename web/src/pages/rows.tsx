/** The rows of a table, over the page: opened from its line among the values. */
import { Dialog } from "../ui/controls/dialog";
import { PanelHost } from "../panels/panel-host";
import type { Deps, App } from "../page/context";
import type { Channel } from "../data/channels";
import { el, LiveText, throttle, type Panel } from "../ui/dom/dom";
import { decimalsOf, number } from "../ui/format/format";
import { choiceWords } from "../ui/format/labels";
import { channelsOf, momentWords, reading, sampleAt } from "../panels/panel-context";

export function RowsDialog({ app, deps }: { readonly app: App; readonly deps: Deps }) {
  const open = app.openTable.value;
  if (!open) return null;
  return (
    <Dialog title={open.title} wide onClose={() => (app.openTable.value = undefined)}>
      <PanelHost class="rows-box" label={open.title} scrolls mount={(host) => mountRows(host, deps, open.name)} />
    </Dialog>
  );
}

/** First of the table's rows that share the time of the row at `i`; −1 if there is none. */
function firstRowAt({ ring }: Pick<Channel, "ring">, i: number): number {
  if (i < 0) return -1;
  const arrival = ring.arrival(i);
  let first = i;
  while (first > 0 && ring.arrival(first - 1) === arrival) first -= 1;
  return first;
}

/** Cell texts, row by row. */
export function cellsOf({ info, ring }: Channel, i: number): readonly (readonly string[])[] {
  const first = firstRowAt({ ring }, i);
  if (first < 0) return [];
  return Array.from({ length: i - first + 1 }, (_, k) =>
    info.columns.map((column, c) => {
      const value = ring.value(c, first + k);
      const choice = column.choices[String(value)];
      return choice === undefined ? number(value, decimalsOf(column)) : choiceWords(choice);
    }),
  );
}

/** Mounts the table of the channel of that name into `host`. */
function mountRows(host: HTMLElement, deps: Deps, name: string): Panel {
  const body = el("tbody");
  const head = el("tr");
  const when = new LiveText();
  const caption = el("caption", { class: "dim" }, when.node);
  const table = el("table", { class: "rows-table" }, caption, el("thead", {}, head), body);
  host.append(table);
  const due = throttle(2);
  let known = "";
  return {
    update(now) {
      if (!due(now)) return;
      const channel = channelsOf(deps).find(({ info }) => info.name === name);
      if (!channel) return;
      const titles = channel.info.columns.map(
        ({ label, name: own, unit }) => `${label || own}${unit ? ` ${unit}` : ""}`,
      );
      if (titles.join("|") !== known) {
        known = titles.join("|");
        head.replaceChildren(...titles.map((title) => el("th", { scope: "col" }, title)));
      }
      const at = reading(deps);
      when.set(momentWords(at));
      body.replaceChildren(
        ...cellsOf(channel, sampleAt(channel, at)).map((cells) =>
          el("tr", {}, ...cells.map((text) => el("td", { class: "num" }, text))),
        ),
      );
    },
    dispose: () => table.remove(),
  };
}
