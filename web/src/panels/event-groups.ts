/**
 * Grouping and filtering of events: repeats become one line with a count. Pure.
 *
 * A bad cable causes ten events a second, each with its own words; a line for each would displace everything else. Events of one
 * sort that follow each other within AGAIN_S are a group: it gives their number, their total, and their first and last time.
 */
import type { Sort } from "../page/context";
import { number } from "../ui/format/format";
import type { EventInfo, EventKind, Level } from "../wire/types";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/panels";

export const SORTS: readonly { readonly name: Sort; readonly title: string }[] = [
  { name: "all", title: COMMON.all },
  { name: "loss", title: TEXT.lossAndClock },
  { name: "device", title: TEXT.deviceAndLink },
  { name: "commands", title: TEXT.commandsAndReplies },
  { name: "markers", title: COMMON.markers },
  { name: "alarms", title: TEXT.alarms },
];

const SORT_OF: Readonly<Record<EventKind, Exclude<Sort, "all">>> = {
  gap: "loss",
  reject: "loss",
  clock: "loss",
  link: "device",
  device: "device",
  text: "device",
  reply: "commands",
  command: "commands",
  marker: "markers",
  alarm: "alarms",
};

export interface EventGroup {
  /** `seq` of the first: constant while the group grows. */
  readonly key: number;
  readonly kind: EventKind;
  readonly level: Level;
  readonly text: string;
  /** Times of the first and the last, unix s. */
  readonly from: number;
  readonly to: number;
  readonly count: number;
  /** Interval to show, unix s: that of the newest event, or its moment. */
  readonly t0: number;
  readonly t1: number;
}

/** A repetition after this long starts a new group, s. */
const AGAIN_S = 30;
const LEVELS: readonly Level[] = ["info", "warning", "error"];

/** Grouping key of an event: some sorts are grouped whatever their words, others only with equal words. */
function sortOf({ seq, kind, device, text, data }: EventInfo): string {
  if (kind === "gap") return `gap ${device} ${String(data["by"] ?? "")}`;
  if (kind === "reject") return `reject ${device}`;
  if (kind === "clock") return `clock ${device} ${String(data["kind"] ?? "")}`;
  if (kind === "reply") return `reply ${device} ${String(data["message"] ?? text)}`;
  if (kind === "marker") return `marker ${seq}`; // each stands for itself
  return `${kind} ${device} ${text}`;
}

/** Groups of the filtered events, newest first, at most `most`. */
export function eventGroups(events: readonly EventInfo[], sort: Sort, most: number): readonly EventGroup[] {
  const open = new Map<string, EventInfo[]>();
  const found: EventInfo[][] = [];
  for (const event of events) {
    if (sort !== "all" && SORT_OF[event.kind] !== sort) continue;
    const key = sortOf(event);
    const group = open.get(key);
    if (group && event.time - group.at(-1)!.time <= AGAIN_S) group.push(event);
    else {
      const begun = [event];
      open.set(key, begun);
      found.push(begun);
    }
  }
  const latest = (group: readonly EventInfo[]): EventInfo => group.at(-1)!;
  found.sort((a, b) => latest(b).time - latest(a).time || latest(b).seq - latest(a).seq);
  return found.slice(0, most).map(groupOf);
}

function groupOf(group: readonly EventInfo[]): EventGroup {
  const [first, last] = [group[0]!, group.at(-1)!];
  const level = LEVELS[Math.max(...group.map((one) => LEVELS.indexOf(one.level)))]!;
  const n = group.reduce((sum, { data }) => sum + (typeof data["gaps"] === "number" ? data["gaps"] : 1), 0);
  return {
    key: first.seq,
    kind: last.kind,
    level,
    text: wordsOf(group, n),
    from: first.time,
    to: last.time,
    count: n,
    t0: last.t0 ?? last.time,
    t1: last.t1 ?? last.time,
  };
}

function wordsOf(group: readonly EventInfo[], n: number): string {
  const last = group.at(-1)!;
  if (group.length === 1) return last.text;
  const samples = group.reduce((sum, one) => sum + one.samples, 0);
  const cause = last.text.slice(last.text.indexOf(": ") + 2);
  if (last.kind === "gap") {
    const lost = samples > 0 ? TEXT.thenSamplesLost(samples) : "";
    return TEXT.gapsBecause(n, lost, cause);
  }
  if (last.kind === "reject") return TEXT.framesRejected(samples, number(group.length, 0), cause);
  return TEXT.repeated(last.text, number(group.length, 0));
}
