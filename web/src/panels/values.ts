/**
 * The values table, for every channel of the selected device: newest value or value at the cursor, mean and σ over the window. Text
 * nodes are written in the frame loop, numbers 12 times a second; statistics in turn, a little in every frame, because a long
 * window of a fast device is millions of samples. Nothing moves when digits do.
 */
import type { Channel } from "../data/channels";
import { throttle, el, LiveText, type Panel, unit } from "../ui/dom/dom";
import { age, decimalsOf, NONE, number, span } from "../ui/format/format";
import { ageOf, channelsOf, momentWords, reading, sampleAt } from "./panel-context";
import type { Deps } from "../page/context";
import { DTYPE_SIZE } from "../wire/frame";
import { valueGroups, type ValueRow } from "./value-groups";
import type { CursorReading } from "../data/cursor-time";
import { registerPanel } from "./registry";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/panels";

/** Time for statistics in one frame's 16 ms, in ms; one line is done in any case. */
const STATS_MS = 0.7;

interface Line {
  readonly row: ValueRow;
  readonly channel: Channel;
  readonly now: LiveText;
  readonly mean: LiveText | undefined;
  readonly sd: LiveText | undefined;
  /** Age of a plain number if overdue. */
  readonly old: LiveText | undefined;
  readonly tr: HTMLElement;
}

/** Mounts the table into `host`; the source of the numbers is written into `headline`. */
function mountValues(host: HTMLElement, deps: Deps, headline: HTMLElement | null): Panel {
  const when = new LiveText();
  const [word, mean] = [new LiveText(), new LiveText()];
  const caption = el("span", { class: "when" }, when.node);
  headline?.append(caption);
  const body = el("tbody");
  const head = el("tr", {}, el("td"), el("th", { class: "num", scope: "col" }, word.node));
  head.append(el("th", { class: "num", scope: "col" }, mean.node), el("th", { class: "num", scope: "col" }, "σ"));
  const columns = ["label", "now", "mean", "deviation"].map((name) => el("col", { class: name }));
  const label = el("caption", { class: "visually-hidden" }, TEXT.valuesLabel);
  const table = el(
    "table",
    { class: "values-table" },
    label,
    el("colgroup", {}, ...columns),
    el("thead", {}, head),
    body,
  );
  host.append(table);

  let shown: readonly Channel[] = [];
  let lines: readonly Line[] = [];
  let turn = 0;
  const numbersDue = throttle(12);
  const statsDue = throttle(3);
  return {
    update(frame) {
      if (turn < lines.length) turn = writeSomeStats(lines, turn, reading(deps), deps);
      else if (statsDue(frame)) turn = 0;
      if (!numbersDue(frame)) return;
      const channels = channelsOf(deps);
      if (channels.length !== shown.length || channels.some((channel, i) => channel !== shown[i])) {
        shown = channels;
        lines = build(body, channels, deps);
      }
      const at = reading(deps);
      word.set(TEXT.reading[at.word]);
      when.set(whenOf(deps, at));
      mean.set(meanOf(deps, at));
      for (const line of lines) {
        const text = valueText(line, at);
        line.now.set(text);
        if (text.length > MAX_VALUE_CHARS && line.mean) widen(line);
        const stale = deps.held() ? undefined : staleness(line, at, deps.store.edgeOf(line.channel.info.device));
        line.tr.classList.toggle("old", stale !== undefined);
        line.old?.set(stale === undefined ? "" : ` ${stale}`);
        showAge(line, stale);
      }
    },
    dispose() {
      table.remove();
      caption.remove();
    },
  };
}

/** Characters of a number that fit in its column; those of a name and its unit before the numbers. */
const MAX_VALUE_CHARS = 10;
const MAX_LABEL_CHARS = 5;

/** Gives a long number, of a clock or a position, the column of its mean, which would be as long. */
export function widen({ now, mean }: Pick<Line, "now" | "mean">): void {
  now.node.parentElement?.setAttribute("colspan", "2");
  mean?.node.parentElement?.remove();
}

/** A value this long overdue is old, s; and by this many of its usual spacings. */
const OLD_S = 3;
const OLD_STEPS = 5;

/** Age of the newest value, "3 min", if it exceeds its channel's pace; undefined while fresh, or for another moment. */
export function staleness(
  { channel: { ring } }: Pick<Line, "channel">,
  at: Pick<CursorReading, "word">,
  now: number,
): string | undefined {
  if (at.word !== "now" || ring.length === 0) return undefined;
  const seconds = now - ring.arrival(ring.length - 1);
  if (!(seconds > Math.max(OLD_S, OLD_STEPS * (ring.step || 0)))) return undefined;
  const { value, unit: words } = age(seconds);
  return `${value} ${words}`;
}

/** Shows how old the value is in place of its statistics: an age is neither a mean nor a σ, and has both cells. */
export function showAge({ mean, sd }: Pick<Line, "mean" | "sd">, stale: string | undefined): void {
  const [cell, other] = [mean?.node.parentElement, sd?.node.parentElement];
  if (!cell?.parentElement || !other) return; // a long number stands there
  if (stale !== undefined) mean?.set(TEXT.ageOf(stale));
  if (other.hidden === (stale !== undefined)) return;
  cell.setAttribute("colspan", stale === undefined ? "1" : "2");
  other.hidden = stale !== undefined;
}

function whenOf(deps: Deps, at: CursorReading): string {
  if (at.word === "now" && deps.held()) {
    const old = age(ageOf(deps, deps.viewState.device.value ?? ""));
    return TEXT.heldFor(old.value, old.unit);
  }
  if (at.word !== "now") return momentWords(at);
  const window = span(deps.viewState.span.value);
  return TEXT.windowLength(window.value, window.unit);
}

/** "mean", with its stretch where the caption says another moment: "mean A–B", "mean 20 s". */
function meanOf({ viewState }: Deps, { word }: CursorReading): string {
  if (word === "now") return TEXT.mean;
  if (word === "cursor" && viewState.measure.value !== undefined) return TEXT.meanOf(TEXT.fromAToB);
  const { value, unit: words } = span(viewState.span.value);
  return TEXT.meanOf(`${value} ${words}`);
}

function build(body: HTMLTableSectionElement, channels: readonly Channel[], deps: Deps): readonly Line[] {
  const byId = new Map(channels.map((channel) => [channel.info.id, channel]));
  const lines: Line[] = [];
  body.replaceChildren();
  for (const group of valueGroups(channels.map((channel) => channel.info))) {
    const title = el("th", { colspan: "4", scope: "rowgroup" }, group.title);
    if (group.unit) title.append(unit(group.unit));
    if (group.frame) title.append(el("span", { class: "dim" }, ` ${group.frame}`));
    if (!group.verified) title.append(el("span", { class: "tag warn" }, COMMON.unverified));
    body.append(el("tr", { class: "group-row" }, title));
    for (const row of group.rows) {
      const channel = byId.get(row.channel.id);
      if (channel) lines.push(addLine(body, row, channel, deps));
    }
  }
  return lines;
}

function addLine(body: HTMLTableSectionElement, row: ValueRow, channel: Channel, deps: Deps): Line {
  const now = new LiveText();
  const help = row.info?.doc || row.channel.doc;
  let name = el(
    "th",
    { scope: "row", class: row.colour ? `axis-${row.colour}` : "plain", ...(help ? { title: help } : {}) },
    row.label,
  );
  if (row.unit) name.append(unit(row.unit));
  if (row.colour !== "" && row.label.length + (row.unit ?? "").length > MAX_LABEL_CHARS) {
    // above its numbers, as the name of a quantity with axes
    body.append(el("tr", { class: "long-name" }, name));
    name.setAttribute("colspan", "4");
    name.setAttribute("scope", "rowgroup");
    name = el("th", { scope: "row" }, el("span", { class: "visually-hidden" }, row.label));
  }
  // A row with statistics has four cells; a plain one gives its words and its number half of the width each.
  if (row.colour !== "") {
    const [mean, sd] = [new LiveText(), new LiveText()];
    const cells = [now, mean, sd].map((live) => el("td", { class: "num" }, live.node));
    const tr = el("tr", {}, name, ...cells);
    body.append(tr);
    return { row, channel, now, mean, sd, old: undefined, tr };
  }
  const words = row.info && Object.keys(row.info.choices).length > 0;
  name.setAttribute("colspan", "2");
  const cell = el("td", { class: words ? "num words" : "num", colspan: "2" }, now.node);
  const shownUnit = row.info?.unit ?? (row.column < 0 ? "rows" : "");
  // A unit that is itself a number (a tick of 0.1 ms) is a factor.
  if (shownUnit) cell.append(unit(/^\d/.test(shownUnit) ? `× ${shownUnit}` : shownUnit));
  if (row.column < 0) {
    const open = el(
      "button",
      { type: "button", class: "btn small edge", "aria-label": TEXT.showRowsOf(row.label) },
      TEXT.show,
    );
    open.addEventListener("click", () => deps.open.rows(channel.info.name, row.label));
    cell.append(" ", open);
  }
  const old = new LiveText();
  cell.append(el("span", { class: "unit" }, old.node));
  const tr = el("tr", {}, name, cell);
  body.append(tr);
  return { row, channel, now, mean: undefined, sd: undefined, old, tr };
}

function valueText(line: Line, at: CursorReading): string {
  const { row, channel } = line;
  const i = sampleAt(channel, at);
  if (i < 0) return NONE;
  if (!row.info) return number(rowsAt(channel, i), 0);
  const value = channel.ring.value(row.column, i);
  const choice = row.info.choices[String(value)];
  if (choice !== undefined) return choice;
  if (row.info.bits.length > 0) return hex(value, 2 * DTYPE_SIZE[row.info.dtype]);
  return number(value, decimalsOf(row.info, row.info.unit || row.channel.unit));
}

/** A flag word as in its document: "0x0000003F". */
function hex(value: number, digits: number): string {
  return Number.isFinite(value) ? `0x${Math.trunc(value).toString(16).toUpperCase().padStart(digits, "0")}` : NONE;
}

/** How many rows of a table share the time of the row at `i`. */
function rowsAt(channel: Channel, i: number): number {
  const { ring } = channel;
  const arrival = ring.arrival(i);
  let n = 0;
  while (i - n >= 0 && ring.arrival(i - n) === arrival) n += 1;
  return n;
}

/** Compute statistics of as many lines as fit in the spare time of a frame; returns where to continue. */
function writeSomeStats(lines: readonly Line[], from: number, at: CursorReading, deps: Deps): number {
  const until = performance.now() + STATS_MS;
  let turn = from;
  do {
    const line = lines[turn];
    if (line) writeStats(line, at, deps);
    turn += 1;
  } while (turn < lines.length && performance.now() < until);
  return turn;
}

function writeStats(line: Line, at: CursorReading, deps: Deps): void {
  const { row, channel, mean, sd } = line;
  if (!mean || !sd || !row.info || line.tr.classList.contains("old")) return;
  const decimals = decimalsOf(row.info, row.info.unit || row.channel.unit);
  const stats = deps.statistics
    ? deps.statistics(channel, row.column, at)
    : channel.ring.stats(row.column, at.from, at.to, deps.viewState.timeBase.value);
  mean.set(stats && stats.n > 0 ? number(stats.mean, decimals) : NONE);
  sd.set(stats && stats.n > 1 ? number(stats.sigma, decimals) : NONE);
}

registerPanel({ id: "values", title: TEXT.values, where: "side", order: 0, class: "values-box", mount: mountValues });
