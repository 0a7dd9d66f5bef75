/**
 * Conditions in which a robot needs attention, from the most urgent one to none. The order of the list, the counts above it, its filters
 * and the colours of cells and map all come from here. Pure.
 */
import type { RobotDevice, RobotSummary } from "../../../wire/routes";

export type Tone = "warn" | "bad";

export type ConditionName =
  | "lost"
  | "name"
  | "device"
  | "alarm"
  | "warning"
  | "loss"
  | "fix"
  | "slow"
  | "disk"
  | "drifted"
  | "acknowledged";

/** A device is slow below this share of the rate that it is configured for. */
const SLOW_SHARE = 0.9;
/** Free space at which a recording can soon not be continued, bytes. */
const LITTLE_FREE = 2e9;

/** Tone of the alarms of robots: red only if one of them is an error. */
export const toneOfAlarms = (robots: readonly { readonly summary: RobotSummary }[]): Tone =>
  robots.some(({ summary }) => raised(summary, "error") > 0) ? "bad" : "warn";

/** Raised alarms. A level that this page does not know counts as a warning. */
export const raised = (robot: RobotSummary, level: "error" | "warning"): number =>
  robot.alarms.reduce(
    (sum, one) => sum + (one.state !== "acknowledged" && (one.level === "error") === (level === "error") ? 1 : 0),
    0,
  );

/** Whether its samples come, or are about to. */
const isDown = ({ status }: RobotDevice): boolean => status === "lost" || status === "denied";
export const isLosing = ({ loss }: RobotDevice): boolean => (loss ?? 0) > 0;
/** Whether it has a receiver of satellites that does not know where it is. */
export const hasNoFix = ({ fix }: RobotDevice): boolean => /^(no\b|none\b|invalid)/i.test(fix);
export const isSlow = ({ status, rate, expected_rate: expected }: RobotDevice): boolean =>
  status === "live" && expected !== null && rate < SLOW_SHARE * expected;
export const hasLittleFree = ({ disk_free_bytes: free }: RobotSummary): boolean => free !== null && free < LITTLE_FREE;

interface Condition {
  readonly name: ConditionName;
  readonly tone: Tone;
  /** How bad it is, above 0; 0: it does not hold. */
  readonly measure: (robot: RobotSummary) => number;
}

const countOf =
  (test: (device: RobotDevice) => boolean) =>
  ({ devices }: RobotSummary): number =>
    devices.reduce((sum, device) => sum + (test(device) ? 1 : 0), 0);

/** The most urgent first. Of lost robots the one that was lost last is first: the others are known. */
export const CONDITIONS: readonly Condition[] = [
  { name: "lost", tone: "bad", measure: ({ state, since }) => (state === "lost" ? Math.max(since, 1) : 0) },
  { name: "name", tone: "bad", measure: ({ same_name: others }) => others },
  { name: "alarm", tone: "bad", measure: (robot) => raised(robot, "error") },
  { name: "device", tone: "bad", measure: countOf(isDown) },
  { name: "warning", tone: "warn", measure: (robot) => raised(robot, "warning") },
  { name: "loss", tone: "warn", measure: ({ devices }) => Math.max(0, ...devices.map(({ loss }) => loss ?? 0)) },
  { name: "fix", tone: "warn", measure: countOf(hasNoFix) },
  { name: "slow", tone: "warn", measure: countOf(isSlow) },
  {
    name: "disk",
    tone: "warn",
    measure: (robot) => (hasLittleFree(robot) ? 1 / (1 + (robot.disk_free_bytes ?? 0)) : 0),
  },
  { name: "drifted", tone: "warn", measure: ({ settings, drifted }) => (settings === "drifted" ? 1 + drifted : 0) },
  {
    name: "acknowledged",
    tone: "warn",
    measure: ({ alarms }) => alarms.filter(({ state }) => state === "acknowledged").length,
  },
];

export interface Health {
  /** Those that hold, the most urgent first. */
  readonly conditions: readonly ConditionName[];
  readonly tone: Tone | undefined;
  /** Index of the most urgent one; the number of all conditions if none holds. */
  readonly rank: number;
  readonly measure: number;
}

/**
 * Health of a robot. Of a lost one nothing else counts: its other figures are from before.
 */
export function healthOf(robot: RobotSummary): Health {
  const found: ConditionName[] = [];
  let [rank, measure, tone]: [number, number, Tone | undefined] = [CONDITIONS.length, 0, undefined];
  CONDITIONS.forEach((condition, i) => {
    if (found[0] === "lost") return;
    const value = condition.measure(robot);
    if (value <= 0) return;
    if (found.length === 0) [rank, measure, tone] = [i, value, condition.tone];
    found.push(condition.name);
  });
  return { conditions: found, tone, rank, measure };
}

/** The device that a row shows: the one with the most urgent trouble, else the first. */
export function worstDevice({ devices }: RobotSummary): RobotDevice | undefined {
  const badness = (device: RobotDevice): number =>
    (isDown(device) ? 8 : 0) + (isLosing(device) ? 4 : 0) + (hasNoFix(device) ? 2 : 0) + (isSlow(device) ? 1 : 0);
  return devices.reduce<RobotDevice | undefined>(
    (worst, one) => (worst === undefined || badness(one) > badness(worst) ? one : worst),
    undefined,
  );
}
