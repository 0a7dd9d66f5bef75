/**
 * Health of the selected device: rates, losses, load, jitter and clock, their last minute, and one sentence on where data was lost.
 * Written twice a second; the age of the last sample ten times.
 */
import { type Surface, surface } from "../ui/dom/canvas";
import { el, throttle, LiveText, LiveMessage, type Panel } from "../ui/dom/dom";
import { age, number } from "../ui/format/format";
import { countsLosses } from "../wire/capabilities";
import type { DeviceHealth, DeviceInfo, MessageHealth } from "../wire/types";
import { behindWords } from "./behind-text";
import { ageOf, channelsOf, channelInfos, recently, selected, usualStep } from "./panel-context";
import type { Deps } from "../page/context";
import {
  type HealthQuantity,
  healthFigures,
  isLeftOut,
  type HealthKey,
  timeWords,
  totals,
  verdict,
  presumedWords,
} from "./health-text";
import { drawBars, drawLevel, drawTicks } from "./sparkline";
import { rateBars } from "../data/health-history";
import { rejections, trustOf } from "./authenticity";
import { registerPanel } from "./registry";
import { mountUneven } from "./uneven-times";
import { Notices } from "./notices";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/panels";

/** Bars in a small sparkline: one for two seconds. */
const SPARKLINE_SLOTS = 31;

const ROWS: readonly {
  readonly key: HealthKey;
  readonly name: string;
  readonly help: string;
  readonly spark: boolean;
}[] = [
  { key: "samples", name: TEXT.samples, help: TEXT.samplesHelp, spark: true },
  { key: "gaps", name: TEXT.gaps, help: TEXT.gapsHelp, spark: true },
  { key: "rejects", name: COMMON.rejects, help: TEXT.rejectsHelp, spark: true },
  { key: "bytes", name: COMMON.bytes, help: TEXT.bytesHelp, spark: false },
  { key: "shareText", name: TEXT.shareOfLink, help: TEXT.shareHelp, spark: false },
  { key: "jitter", name: TEXT.arrivalJitter, help: TEXT.jitterHelp, spark: true },
  { key: "age", name: TEXT.lastSample, help: TEXT.lastSampleHelp, spark: false },
  { key: "dropped", name: TEXT.droppedHere, help: TEXT.droppedHelp, spark: false },
  { key: "drift", name: TEXT.clockDrift, help: TEXT.driftHelp, spark: false },
  { key: "uncertainty", name: COMMON.deviceTime, help: TEXT.deviceTimeHelp, spark: false },
];

/** Attributes of a figure; an extension makes links of those on the time of the stream. */
const about = (key: HealthKey): Readonly<Record<string, string>> =>
  ["gaps", "jitter", "drift", "uncertainty"].includes(key) ? { "data-about": "time" } : {};

/** A figure and its unit; with a tag if it needs attention. */
class Cell {
  readonly node = el("dd");
  readonly #value = new LiveText();
  readonly #unit = new LiveText();
  readonly #box = el("span", {}, this.#value.node);
  readonly #after = el("span", { class: "unit" }, this.#unit.node);

  constructor() {
    this.node.append(this.#box, this.#after);
  }

  set(figure: HealthQuantity): void {
    const tagged = figure.tone !== "";
    this.#value.set(tagged && figure.unit ? `${figure.value} ${figure.unit}` : figure.value);
    this.#unit.set(tagged ? "" : figure.unit);
    const name = tagged ? `tag ${figure.tone}` : "";
    if (this.#box.className !== name) this.#box.className = name;
  }
}

/** The figures of the selected device now, and what else is known of it. */
function figuresNow(deps: Deps) {
  const device = selected(deps);
  const id = device?.id ?? "";
  const health = deps.store.health.value.get(id);
  const dropped = Math.max(deps.store.dropped(), health?.dropped ?? 0);
  const isExpected = device?.status !== "ended" && device?.status !== "idle";
  const isCounted = countsLosses(device, channelInfos(deps));
  const recent = recently(deps, id);
  const figures = healthFigures(health, recent, ageOf(deps, id), dropped, isExpected, isCounted, usualStep(deps, id));
  return { device, id, health, dropped, figures };
}

function mountHealth(host: HTMLElement, deps: Deps, caption: HTMLElement | null): Panel {
  const list = el("dl", { class: "health-list" });
  const cells = new Map<HealthKey, Cell>();
  const sparks = new Map<HealthKey, Surface>();
  const rows = new Map<HealthKey, HTMLElement>();
  const fill = el("i");
  const uneven = mountUneven();
  for (const { key, name, help, spark } of ROWS) {
    const cell = new Cell();
    const mini = el("dd", { class: "mini-chart", "aria-hidden": "true" });
    if (spark) {
      const canvas = el("canvas");
      mini.append(canvas);
      sparks.set(
        key,
        surface(canvas, () => undefined),
      );
    }
    if (key === "shareText") mini.append(el("span", { class: "meter" }, fill));
    if (key === "uncertainty") {
      mini.append(uneven.button);
      mini.removeAttribute("aria-hidden");
    }
    const row = el("div", { title: help }, el("dt", {}, el("span", about(key), name)), mini, cell.node);
    list.append(row);
    rows.set(key, row);
    cells.set(key, cell);
  }
  const messages = mountMessages(list, deps);
  const reasons = mountReasons(list);
  const words = new LiveMessage(el("p", { class: "note verdict" }));
  const presumed = new LiveMessage(el("p", { class: "note" }));
  host.append(list, presumed.node, words.node, uneven.node);
  const held = new LiveText();
  caption?.append(el("span", { class: "when" }, held.node));
  const [figuresDue, ageDue] = [throttle(2), throttle(10)];
  return {
    update(now) {
      const all = figuresDue(now);
      if (!all && !ageDue(now)) return;
      const { device, id, health, dropped, figures } = figuresNow(deps);
      cells.get("age")?.set(figures.age);
      if (!all) return;
      const old = age(ageOf(deps, id));
      held.set(deps.recording === undefined && deps.store.isCut ? ` ${TEXT.heldFor(old.value, old.unit)}` : "");
      for (const [key, row] of rows) row.hidden = isLeftOut(key, device, deps.recording !== undefined);
      for (const [key, cell] of cells) cell.set(figures[key]);
      fill.style.width = `${(100 * Math.min(1, figures.share ?? 0)).toFixed(1)}%`;
      messages.update(health);
      reasons.update(health, device);
      const behind = deps.store.behind(id);
      const why = behind.total > 0 ? `${behindWords(behind)} ${TEXT.behindRemedy[behind.part]} ` : "";
      words.set(
        why + verdict(device, channelInfos(deps), deps.store.events.value, health, dropped, deps.lostLater?.(id)),
      );
      list.title = totals(health);
      words.node.hidden = words.isEmpty;
      presumed.set(presumedWords(health));
      presumed.node.hidden = presumed.isEmpty;
      uneven.update(health);
      drawSparks(deps, id, sparks, device?.status === "lost");
    },
    dispose() {
      for (const spark of sparks.values()) spark.dispose();
      list.remove();
      words.node.remove();
      presumed.node.remove();
      uneven.node.remove();
      held.node.parentElement?.remove();
    },
  };
}

/** Messages seen at least this often stream; answers and greetings come once or twice. */
const MIN_STREAM_SAMPLES = 5;

/** One line per message that streams, below the samples; none while there is only one. */
function mountMessages(list: HTMLElement, deps: Deps): { update(health: DeviceHealth | undefined): void } {
  let lines: { readonly name: string; readonly row: HTMLElement; readonly cell: Cell }[] = [];
  const figure = (one: MessageHealth): HealthQuantity => ({ value: number(one.rate, 1), unit: "/s", tone: "" });
  return {
    update(health) {
      const channels = channelsOf(deps);
      // answers to a reading are no streams: they would stand here with 0.0 /s from then on
      const isStream = ({ name, count, rate }: MessageHealth): boolean =>
        count >= MIN_STREAM_SAMPLES && (rate > 0 || channels.some(({ info }) => info.message === name));
      const streaming = health?.messages.filter(isStream) ?? [];
      const several = streaming.length > 1 ? streaming : [];
      if (several.length !== lines.length || several.some((one, i) => one.name !== lines[i]?.name)) {
        for (const line of lines) line.row.remove();
        lines = several.map((one) => {
          const cell = new Cell();
          const group = channelsOf(deps).find(({ info }) => info.message === one.name)?.info.group;
          const row = el("div", { class: "sub-row" }, el("dt", { title: one.name }, group || one.name), cell.node);
          return { name: one.name, row, cell };
        });
        list.firstElementChild?.after(...lines.map((line) => line.row));
      }
      several.forEach((one, i) => lines[i]?.cell.set(figure(one)));
    },
  };
}

/**
 * Lines under the rejects: their reasons since the session began, in one line that is always there (a line for each reason would move
 * the content below whenever a busy machine cuts a frame); and the numbers of verified and unverified samples.
 */
function mountReasons(list: HTMLElement): {
  update(health: DeviceHealth | undefined, device: DeviceInfo | undefined): void;
} {
  const lines = new Map<string, { readonly row: HTMLElement; readonly cell: Cell }>();
  const reasons = new LiveText();
  const why = el("div", { class: "sub-row reasons" }, el("dt", {}, TEXT.sinceStart), el("dd", {}, reasons.node));
  const rejects = [...list.children].find((row) => row.firstElementChild?.textContent === COMMON.rejects);
  rejects?.after(why);
  return {
    update(health, device) {
      const wanted = new Map<string, HealthQuantity>();
      const passed = device && trustOf(device, health)?.mark === "○" ? TEXT.headerChecked : TEXT.trust.verified;
      const reasonsShown = rejections(health).map(({ words, count }) => `${words} ${number(count, 0)}`);
      reasons.set(reasonsShown.join(", ") || COMMON.none);
      why.title = reasonsShown.join(", ");
      if (health?.unverified)
        wanted.set(TEXT.trust.unverified, {
          value: `▲ ${number(health.unverified, 0)}`,
          unit: TEXT.samplesUnit,
          tone: "warn",
        });
      if (typeof health?.verified === "number")
        wanted.set(passed, { value: number(health.verified, 0), unit: TEXT.samplesUnit, tone: "" });
      for (const [name, line] of lines) {
        if (wanted.has(name)) continue;
        line.row.remove();
        lines.delete(name);
      }
      let last: Element = why;
      for (const [name, figure] of wanted) {
        let line = lines.get(name);
        if (!line) {
          const cell = new Cell();
          line = { cell, row: el("div", { class: "sub-row" }, el("dt", {}, name), cell.node) };
          lines.set(name, line);
          last.after(line.row);
        }
        line.cell.set(figure);
        last = line.row;
      }
    },
  };
}

function drawSparks(deps: Deps, id: string, sparks: ReadonlyMap<HealthKey, Surface>, gone: boolean): void {
  const moments = deps.recentHealth.of(id);
  const draw = (key: HealthKey, how: (to: Surface) => void): void => {
    const to = sparks.get(key);
    if (to) how(to);
  };
  draw("samples", (to) => drawBars(to, rateBars(moments, deps.store.edgeOf(id), SPARKLINE_SLOTS), gone));
  // One report in four, the newest at the right, the same scale however short the past is.
  const lately = moments.filter((_, i) => (moments.length - 1 - i) % 4 === 0).slice(-SPARKLINE_SLOTS);
  const slots = <T>(values: readonly T[]): readonly (T | undefined)[] => [
    ...new Array<undefined>(SPARKLINE_SLOTS - values.length).fill(undefined),
    ...values,
  ];
  draw("gaps", (to) => drawTicks(to, slots(lately.map((moment) => moment.lost))));
  draw("rejects", (to) => drawTicks(to, slots(lately.map((moment) => moment.rejects))));
  const jitter = lately.map((moment) => moment.jitter);
  draw("jitter", (to) => drawLevel(to, slots(jitter), 1.25 * Math.max(0.001, ...jitter.map((value) => value ?? 0))));
}

/** Keys that the page's title line and the phone's strip share. */
export const STRIP: readonly HealthKey[] = ["samples", "gaps", "rejects", "shareText", "jitter", "uncertainty", "age"];

const STRIP_UNITS: Partial<Record<HealthKey, string>> = {
  samples: TEXT.samplesPerSecond,
  gaps: TEXT.samplesLost,
  rejects: TEXT.rejectsUnit,
  shareText: TEXT.ofLink,
  jitter: TEXT.msJitter,
  uncertainty: TEXT.msDeviceTime,
  age: TEXT.oldUnit,
};

/** Health in one line, for the phone. */
function mountStrip(host: HTMLElement, deps: Deps): Panel {
  const why = new LiveMessage(el("span"));
  const late = new LiveText();
  const lateTag = el("span", { class: "tag warn late", hidden: "" }, late.node);
  const simulated = el("span", { class: "tag", hidden: "" }, COMMON.simulated);
  host.append(simulated);
  const items = STRIP.map((key) => {
    const [value, unit] = [new LiveText(), new LiveText()];
    const box = el("b", {}, value.node);
    host.append(el("span", about(key), box, el("span", { class: "unit" }, unit.node)));
    return { key, value, unit, box };
  });
  host.append(why.node, lateTag); // it comes and goes: what a finger aims at stays
  const due = throttle(4);
  return {
    update(now) {
      if (host.offsetParent === null || !due(now)) return;
      const { device, id, health, figures } = figuresNow(deps);
      for (const { key, value, unit, box } of items) {
        if (box.parentElement) box.parentElement.hidden = isLeftOut(key, device, deps.recording !== undefined);
        const figure = figures[key];
        value.set(key === "age" ? `${figure.value} ${figure.unit.replace(TEXT.agoSuffix, "")}` : figure.value);
        unit.set(key === "gaps" && figure.tone ? "" : (STRIP_UNITS[key] ?? figure.unit));
        box.className = figure.tone ? `tag ${figure.tone}` : "";
      }
      simulated.hidden = device?.simulated !== true;
      const behind = deps.store.behind(id);
      lateTag.hidden = behind.total === 0;
      late.set(behind.total > 0 ? behindWords(behind) : "");
      why.set(timeWords(health));
    },
    dispose: () => host.replaceChildren(),
  };
}

registerPanel({
  id: "health",
  title: TEXT.health,
  note: TEXT.lastMinute,
  where: "below",
  order: 0,
  mount: mountHealth,
  after: Notices,
});
registerPanel({ id: "link", title: TEXT.linkHealth, where: "strip", order: 0, class: "strip", mount: mountStrip });
