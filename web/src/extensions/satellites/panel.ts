/**
 * The satellites of each receiver: a bar of C/N0 for each, by constellation. Used, healthy and not used differ by fill and by a word.
 * A table for screen readers; on the screen two satellites are side by side.
 */
import { el, throttle, LiveText, type Panel } from "../../ui/dom/dom";
import { number } from "../../ui/format/format";
import { channelsOf, reading, sampleAt } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import {
  type Constellation,
  type Satellite,
  skyAt,
  type SkyTable,
  skyTables,
  satelliteTally,
  type Use,
} from "./satellite-data";
import { TEXT } from "./texts";
import "./satellites.css";

/** A bar this long is full, dB-Hz: stronger than any satellite. */
const FULL_DBHZ = 55;
const USES: readonly Use[] = ["used", "healthy", "not used", "unhealthy"];

interface Row {
  readonly root: HTMLElement;
  readonly bar: HTMLElement;
  readonly strength: LiveText;
  readonly use: LiveText;
}

/** One receiver's table; rebuilt when a satellite comes or goes. */
class Sky {
  readonly root: HTMLTableElement;
  readonly #table: SkyTable;
  readonly #tallies = new Map<string, LiveText>();
  readonly #rows = new Map<string, Row>();
  #known = "";

  constructor(table: SkyTable, several: boolean) {
    this.#table = table;
    const name = several ? table.channel.info.group : "";
    const caption = el("caption", name ? {} : { class: "visually-hidden" }, name || TEXT.satellitesLabel);
    this.root = el("table", { class: "sky", role: "table" }, caption);
  }

  update(i: number): void {
    const sky = skyAt(this.#table, i);
    const known = sky.map(({ name, satellites }) => `${name} ${satellites.map(({ id }) => id).join(" ")}`).join(";");
    if (known !== this.#known) {
      this.#known = known;
      this.#build(sky);
    }
    for (const { name, satellites } of sky) {
      this.#tallies.get(name)?.set(satelliteTally(satellites));
      for (const satellite of satellites) this.#write(satellite);
    }
  }

  #build(sky: readonly Constellation[]): void {
    this.#rows.clear();
    this.#tallies.clear();
    this.root.querySelectorAll("tbody").forEach((body) => body.remove());
    for (const { name, satellites } of sky) {
      const words = new LiveText();
      this.#tallies.set(name, words);
      const head = el(
        "th",
        { role: "columnheader", scope: "rowgroup", colspan: "4" },
        name,
        " ",
        el("span", { class: "dim" }, words.node),
      );
      const body = el("tbody", { role: "rowgroup" }, el("tr", { role: "row", class: "group-row" }, head));
      for (const { id } of satellites) body.append(this.#row(id));
      this.root.append(body);
    }
  }

  #row(id: string): HTMLElement {
    const [bar, strength, use] = [el("i"), new LiveText(), new LiveText()];
    const cells = [
      el("th", { role: "rowheader", scope: "row" }, id),
      el("td", { role: "cell", class: "signal-strength", "aria-hidden": "true" }, bar),
      el("td", { role: "cell", class: "num" }, strength.node, el("span", { class: "visually-hidden" }, " dB-Hz")),
      el("td", { role: "cell", class: "visually-hidden" }, use.node),
    ];
    const root = el("tr", { role: "row" }, ...cells);
    this.#rows.set(id, { root, bar, strength, use });
    return root;
  }

  #write({ id, strength, use }: Satellite): void {
    const row = this.#rows.get(id);
    if (!row) return;
    const width = `${(100 * Math.min(1, Math.max(0, strength / FULL_DBHZ))).toFixed(0)}%`;
    if (row.bar.style.width !== width) row.bar.style.width = width;
    row.strength.set(number(strength, 0));
    row.use.set(use);
    if (row.root.dataset["use"] === use) return;
    row.root.dataset["use"] = use;
    row.root.title = `${id}: ${use}`;
  }
}

export function mountSatellites(host: HTMLElement, deps: Deps): Panel {
  const key = el(
    "ul",
    { class: "sky-key", "aria-hidden": "true" },
    ...USES.map((use) => el("li", { "data-use": use }, el("i"), use)),
  );
  host.append(key);
  let shown: readonly SkyTable[] = [];
  let skies: readonly Sky[] = [];
  const due = throttle(2);
  return {
    update(now) {
      if (!due(now)) return;
      const tables = skyTables(channelsOf(deps));
      if (tables.length !== shown.length || tables.some(({ channel }, k) => channel !== shown[k]?.channel)) {
        for (const { root } of skies) root.remove();
        shown = tables;
        skies = tables.map((table) => new Sky(table, tables.length > 1));
        host.append(...skies.map(({ root }) => root));
      }
      const at = reading(deps);
      skies.forEach((sky, k) => sky.update(sampleAt(shown[k]!.channel, at)));
    },
    dispose: () => host.replaceChildren(),
  };
}
