/**
 * Events as they are read: what repeats is one line with a count, and what is not looked for can be left out. Pure.
 *
 * A bad cable brings ten events a second, each with its own words; one line for each would push out what a person looks for. Events of one
 * sort that follow each other within AGAIN_S are a group: it says how many, what they amount to, and from when to when.
 */
import { count, number } from "../ui/format";
import type { EventInfo, EventKind, Level } from "../wire/types";

/** What can be asked for. */
export type Sort = "all" | "loss" | "device" | "commands" | "markers";

export const SORTS: readonly { readonly name: Sort; readonly title: string }[] = [
  { name: "all", title: "All" },
  { name: "loss", title: "Loss and clock" },
  { name: "device", title: "Device and link" },
  { name: "commands", title: "Commands and answers" },
  { name: "markers", title: "Markers" },
];

const SORT_OF: Readonly<Record<EventKind, Exclude<Sort, "all">>> = {
  gap: "loss", reject: "loss", clock: "loss", link: "device", device: "device", text: "device", reply: "commands", command: "commands", marker: "markers",
};

export interface EventGroup {
  /** `seq` of the first: stays while the group grows. */
  readonly key: number;
  readonly kind: EventKind;
  readonly level: Level;
  readonly text: string;
  /** When the first happened and the last, unix s. */
  readonly from: number;
  readonly to: number;
  readonly count: number;
  /** What a look at it shows, unix s: the span that the newest concerns, or its moment. */
  readonly t0: number;
  readonly t1: number;
}

/** A repetition after this long is news again, s. */
const AGAIN_S = 30;
const LEVELS: readonly Level[] = ["info", "caution", "fault"];

/** Events of these sorts are told together whatever their words; others only with the same ones. */
function sortOf({ seq, kind, device, text, data }: EventInfo): string {
  if (kind === "gap") return `gap ${device} ${String(data["by"] ?? "")}`;
  if (kind === "reject") return `reject ${device}`;
  if (kind === "clock") return `clock ${device} ${String(data["kind"] ?? "")}`;
  if (kind === "reply") return `reply ${device} ${String(data["message"] ?? text)}`;
  if (kind === "marker") return `marker ${seq}`; // each is somebody's own
  return `${kind} ${device} ${text}`;
}

/** Groups of what is asked for, newest first, at most `most`. */
export function groupsOf(events: readonly EventInfo[], sort: Sort, most: number): readonly EventGroup[] {
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
  return found.slice(0, most).map(told);
}

function told(group: readonly EventInfo[]): EventGroup {
  const [first, last] = [group[0]!, group.at(-1)!];
  const level = LEVELS[Math.max(...group.map((one) => LEVELS.indexOf(one.level)))]!;
  const n = group.reduce((sum, { data }) => sum + (typeof data["gaps"] === "number" ? data["gaps"] : 1), 0);
  return { key: first.seq, kind: last.kind, level, text: wordsOf(group, n), from: first.time, to: last.time, count: n, t0: last.t0 ?? last.time, t1: last.t1 ?? last.time };
}

function wordsOf(group: readonly EventInfo[], n: number): string {
  const last = group.at(-1)!;
  if (group.length === 1) return last.text;
  const samples = group.reduce((sum, one) => sum + one.samples, 0);
  const cause = last.text.slice(last.text.indexOf(": ") + 2);
  if (last.kind === "gap") {
    const lost = samples > 0 ? `, ${count(samples, "sample")} lost` : "";
    return `${count(n, "gap")}${lost}: ${cause}`;
  }
  if (last.kind === "reject") return `${count(samples, "frame")} rejected, ${number(group.length, 0)} times; lately ${cause}`;
  return `${last.text} (${number(group.length, 0)} times)`;
}
