/** Alarms in words and symbols, the drafts of new ones, and the intervals in which they were raised, from events. Pure. */
import { number } from "../../ui/format/format";
import type { AlarmDefinition, AlarmInfo, AlarmState } from "../../wire/routes";
import type { DeviceInfo, EventInfo, Level } from "../../wire/types";
import { TEXT } from "./texts";

/** What is known of an alarm when its form opens; with an `id` it is a stored one. */
export interface AlarmDraft {
  readonly id?: string;
  readonly definition?: AlarmDefinition;
  /** The condition of a new one. */
  readonly expression?: string;
  /** The device that it is for; absent: the selected one. */
  readonly device?: DeviceInfo | undefined;
}

export interface AlarmOnDevice {
  readonly alarm: AlarmInfo;
  readonly state: AlarmState;
}

/** The alarms of a device, those that need attention first. */
export function alarmsOf(alarms: readonly AlarmInfo[], device: string): readonly AlarmOnDevice[] {
  const own = alarms.flatMap((alarm) =>
    alarm.states.filter((state) => state.device === device).map((state) => ({ alarm, state })),
  );
  return own.sort((a, b) => rankOf(a) - rankOf(b));
}

/** The alarms that no device is evaluated for: disabled ones, or without a device present that fits. */
export function idleAlarms(alarms: readonly AlarmInfo[]): readonly AlarmInfo[] {
  return alarms.filter(({ states }) => states.length === 0);
}

function rankOf({ alarm, state }: AlarmOnDevice): number {
  const order = state.raised && state.acknowledged === null ? 0 : state.raised ? 2 : state.status === "missing" ? 4 : 6;
  return order + (alarm.definition.level === "error" ? 0 : 1);
}

interface Mark {
  readonly symbol: string;
  readonly word: string;
  readonly tone: "" | "warn" | "bad";
}

/** Symbol, word and colour of a state. */
export function alarmMark({ alarm, state }: AlarmOnDevice): Mark {
  const tone = alarm.definition.level === "error" ? "bad" : "warn";
  if (state.problem !== "" || state.status === "missing") {
    const [raised, other] =
      state.problem === "" ? [TEXT.raisedWithoutData, TEXT.noData] : [TEXT.raisedNotEvaluated, TEXT.notEvaluated];
    return { symbol: "?", word: state.raised ? raised : other, tone: state.raised ? tone : "" };
  }
  if (state.status === "raised") return { symbol: tone === "bad" ? "✖" : "▲", word: TEXT.raised, tone };
  if (state.status === "acknowledged") return { symbol: "✓", word: TEXT.acknowledged, tone };
  if (state.status === "pending") return { symbol: "…", word: TEXT.pending, tone: "" };
  return { symbol: "○", word: TEXT.ok, tone: "" };
}

/** Counts of a device for its row: raised and not seen yet, acknowledged, without data. */
export function alarmCounts(own: readonly AlarmOnDevice[]): {
  readonly raised: number;
  readonly worst: Level;
  readonly acknowledged: number;
  readonly missing: number;
} {
  const raised = own.filter(({ state }) => state.raised && state.acknowledged === null);
  return {
    raised: raised.length,
    worst: raised.some(({ alarm }) => alarm.definition.level === "error") ? "error" : "warning",
    acknowledged: own.filter(({ state }) => state.raised && state.acknowledged !== null).length,
    missing: own.filter(({ state }) => (state.status === "missing" || state.problem !== "") && !state.raised).length,
  };
}

/** "31.4 m/s²", with four digits; "" for no value. */
export function valueText(value: number | null, unit: string): string {
  if (value === null) return "";
  const digits = Math.max(0, 3 - Math.floor(Math.log10(Math.max(Math.abs(value), 1e-9))));
  return `${number(value, Math.min(6, digits))}${unit === "" || unit === "°" ? unit : ` ${unit}`}`;
}

/** The condition of a definition, for a line of the list. */
export function conditionText({ condition }: AlarmDefinition): string {
  if (condition.kind === "expression") return condition.expression;
  if (condition.kind === "flag") return TEXT.flagCondition(condition.signal, condition.flag, condition.is_set);
  return TEXT.figureCondition(condition.figure, condition.limit);
}

/** An interval in which an alarm was raised, unix s; `t1` undefined: it still is. */
export interface RaisedSpan {
  readonly alarm: string;
  readonly name: string;
  readonly level: Level;
  readonly signals: readonly string[];
  readonly subject: string;
  readonly limit: number | undefined;
  readonly t0: number;
  readonly t1: number | undefined;
}

const numberIn = (value: unknown): number | undefined => (typeof value === "number" ? value : undefined);

/** The intervals in which alarms of a device were raised, from its events, in order of their beginning. */
export function raisedSpans(events: readonly EventInfo[], device: string): readonly RaisedSpan[] {
  const open = new Map<string, RaisedSpan>();
  const found: RaisedSpan[] = [];
  for (const { kind, device: of, time, level, data } of events) {
    const alarm = data["alarm"];
    if (kind !== "alarm" || of !== device || typeof alarm !== "string") continue;
    const change = data["change"];
    const signals = data["signals"];
    const begun = open.get(alarm);
    const span: RaisedSpan = {
      alarm,
      name: String(data["name"] ?? ""),
      level: data["level"] === "error" ? "error" : data["level"] === "warning" ? "warning" : level,
      signals: Array.isArray(signals) ? signals.map(String) : [],
      subject: String(data["subject"] ?? ""),
      limit: numberIn(data["limit"]),
      t0: numberIn(data["t0"]) ?? time,
      t1: undefined,
    };
    if (change === "raised" && begun === undefined) open.set(alarm, span);
    if (change === "cleared" || change === "repeated") {
      open.delete(alarm);
      const ended = change === "cleared" ? time : (numberIn(data["t1"]) ?? time);
      found.push({ ...(begun ?? span), t1: ended });
      if (change === "repeated" && data["is_raised"] === true) open.set(alarm, { ...span, t0: ended });
    }
  }
  return [...found, ...open.values()].sort((a, b) => a.t0 - b.t0);
}
