/** Which robots are listed, in which order and in which groups. Pure. */
import { type RobotColumn, columnNamed, type SortKey } from "./columns";
import type { ConditionName } from "./conditions";
import type { Robot } from "./robots";
import type { RobotDevice } from "../../../wire/routes";

/** A filter above the list; "alarms" is any raised alarm. */
export const SHOWN = ["all", "live", "lost", "alarms", "device", "loss", "fix", "slow", "disk", "drifted"] as const;
export type RobotFilter = (typeof SHOWN)[number];

export const GROUPINGS = ["none", "group", "product", "firmware", "version"] as const;
export type Grouping = (typeof GROUPINGS)[number];

export interface RobotChoice {
  readonly sort: RobotColumn;
  readonly descending: boolean;
  readonly shown: RobotFilter;
  readonly query: string;
  readonly grouping: Grouping;
}

export const WORST_FIRST: RobotChoice = { sort: "state", descending: true, shown: "all", query: "", grouping: "none" };

export function inShown({ summary, health: { conditions } }: Robot, shown: RobotFilter): boolean {
  if (shown === "all") return true;
  if (shown === "live") return summary.state === "live";
  if (shown === "alarms") return conditions.includes("alarm") || conditions.includes("warning");
  return conditions.includes(shown satisfies ConditionName);
}

export function countAll(robots: Iterable<Robot>): Readonly<Record<RobotFilter, number>> {
  const counts = Object.fromEntries(SHOWN.map((name) => [name, 0])) as Record<RobotFilter, number>;
  for (const robot of robots) for (const name of SHOWN) if (inShown(robot, name)) counts[name] += 1;
  return counts;
}

export function robotMatches({ text }: Robot, words: readonly string[]): boolean {
  return words.every((word) => text.includes(word));
}

export const queryWords = (query: string): readonly string[] => query.toLowerCase().split(/\s+/).filter(Boolean);

/** Value of the grouping; robots with several devices are in the group of all of their values, so that counts add up. */
export function groupOf({ summary }: Robot, grouping: Grouping): string {
  const ofDevices = (value: (device: RobotDevice) => string): string =>
    [...new Set(summary.devices.map(value))].filter(Boolean).sort().join(" + ");
  if (grouping === "group") return summary.group;
  if (grouping === "version") return summary.version;
  if (grouping === "product") return ofDevices(({ product, name }) => product || name);
  if (grouping === "firmware") return ofDevices(({ firmware }) => firmware);
  return "";
}

const BY_NAME = Intl.Collator("en", { numeric: true, sensitivity: "base" });
/** Names as a person orders them: amr-9 before amr-10. */
export const byName = (a: string, b: string): number => BY_NAME.compare(a, b) || (a < b ? -1 : a > b ? 1 : 0);

function byKey(a: SortKey, b: SortKey, direction: number): number {
  if (a === undefined || b === undefined) return (a === undefined ? 1 : 0) - (b === undefined ? 1 : 0);
  if (typeof a === "number" && typeof b === "number") return direction * (a - b);
  return direction * byName(String(a), String(b));
}

/** A group of robots with their names in order. */
export interface RobotGroup {
  readonly title: string;
  readonly names: readonly string[];
}

/** The groups in the order of their titles, unnamed last; without grouping one without a title. */
export function arrange(robots: Iterable<Robot>, choice: RobotChoice): readonly RobotGroup[] {
  const words = queryWords(choice.query);
  const key = columnNamed(choice.sort)?.key ?? (() => undefined);
  const direction = choice.descending ? -1 : 1;
  const groups = new Map<string, { readonly name: string; readonly key: SortKey }[]>();
  for (const robot of robots) {
    if (!inShown(robot, choice.shown) || !robotMatches(robot, words)) continue;
    const title = groupOf(robot, choice.grouping);
    const members = groups.get(title) ?? [];
    groups.set(title, members);
    members.push({ name: robot.summary.name, key: key(robot) });
  }
  const titles = [...groups.keys()].sort((a, b) => Number(a === "") - Number(b === "") || byName(a, b));
  return titles.map((title) => ({
    title,
    names: (groups.get(title) ?? [])
      .sort((a, b) => byKey(a.key, b.key, direction) || byName(a.name, b.name))
      .map(({ name }) => name),
  }));
}

/** The groups of the map; names come in order, and stay in it. */
export function mapGroups(
  names: readonly string[],
  robotOf: (name: string) => Robot | undefined,
  grouping: Grouping,
): readonly RobotGroup[] {
  const groups = new Map<string, string[]>();
  for (const name of names) {
    const robot = robotOf(name);
    if (!robot) continue;
    const title = groupOf(robot, grouping);
    const members = groups.get(title);
    if (members) members.push(name);
    else groups.set(title, [name]);
  }
  const titles = [...groups.keys()].sort((a, b) => Number(a === "") - Number(b === "") || byName(a, b));
  return titles.map((title) => ({ title, names: groups.get(title) ?? [] }));
}

export function isSameOrder(a: readonly RobotGroup[], b: readonly RobotGroup[]): boolean {
  return (
    a.length === b.length &&
    a.every(({ title, names }, i) => {
      const other = b[i];
      return (
        other?.title === title && other.names.length === names.length && names.every((n, k) => other.names[k] === n)
      );
    })
  );
}

/** A line of the list. */
export type Line =
  | { readonly kind: "group"; readonly title: string; readonly names: readonly string[] }
  | { readonly kind: "robot"; readonly name: string }
  | { readonly kind: "device"; readonly name: string; readonly index: number };

/** The lines of groups: folded ones have their head only, expanded robots a line for each device. */
export function robotLines(
  groups: readonly RobotGroup[],
  choice: RobotChoice,
  folded: ReadonlySet<string>,
  devices: (name: string) => number,
): readonly Line[] {
  const lines: Line[] = [];
  for (const { title, names } of groups) {
    if (choice.grouping !== "none") lines.push({ kind: "group", title, names });
    if (choice.grouping !== "none" && folded.has(title)) continue;
    for (const name of names) {
      lines.push({ kind: "robot", name });
      const more = devices(name);
      for (let index = 0; index < more; index++) lines.push({ kind: "device", name, index });
    }
  }
  return lines;
}
