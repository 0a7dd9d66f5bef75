/** The columns of the fleet: what a cell says, and what it is sorted by. Pure. */
import { age, number, rate } from "../../../ui/format/format";
import { TEXT } from "./texts";
import { CONDITIONS, hasLittleFree, hasNoFix, isLosing, isSlow, raised, type Tone } from "./conditions";
import type { Robot } from "./robots";
import type { RobotDevice } from "../../../wire/routes";

export type RobotColumn =
  | "name"
  | "state"
  | "device"
  | "rate"
  | "loss"
  | "fix"
  | "temperature"
  | "clock"
  | "firmware"
  | "settings"
  | "recording"
  | "disk"
  | "alarms"
  | "latency";

/** A text with its unit apart, and its status. */
export interface RobotCell {
  readonly text: string;
  readonly unit?: string;
  /** More of it, smaller and after the unit. */
  readonly more?: string;
  readonly tone?: Tone | undefined;
  /** As expected: nothing that a user looking for trouble has to see. */
  readonly isQuiet?: boolean;
}

/** What rows are sorted by: numbers, or words; undefined comes last in both directions. */
export type SortKey = number | string | undefined;

interface Column {
  readonly name: RobotColumn;
  readonly title: string;
  /** Whether its figures stand at the right. */
  readonly figures: boolean;
  /** Whether the largest comes first when the column is chosen: the end that needs attention. */
  readonly largestFirst: boolean;
  readonly key: (robot: Robot) => SortKey;
}

const EMPTY: RobotCell = { text: "—", isQuiet: true };
const orNothing = (value: number | null | undefined): number | undefined => value ?? undefined;

/** "0.31 %", and never 0 for a loss that there is. */
export function lossCell(loss: number | null): RobotCell {
  if (loss === null) return EMPTY;
  const percent = 100 * loss;
  if (percent === 0) return { text: "0", unit: "%", isQuiet: true };
  if (percent < 0.01) return { text: "<\u20090.01", unit: "%", tone: "warn" };
  return { text: number(percent, percent < 1 ? 2 : 1), unit: "%", tone: "warn" };
}

export function rateCell(device: RobotDevice): RobotCell {
  const expected = device.expected_rate;
  return {
    text: rate(device.rate),
    unit: "Hz",
    ...(expected === null ? {} : { more: TEXT.ofRate(rate(expected)) }),
    tone: isSlow(device) ? "warn" : undefined,
  };
}

export function clockCell({
  clock_ppm: ppm,
  clock_ppm_uncertainty: bound,
  clock_uncertainty_ms: uncertainty,
}: RobotDevice): RobotCell {
  if (ppm === null && uncertainty === null) return EMPTY;
  if (ppm === null) return { text: `±\u2009${number(orNothing(uncertainty), 2)}`, unit: "ms" };
  return {
    text: bound === null ? number(ppm, 1) : `${number(ppm, 1)} ±\u2009${number(bound, 1)}`,
    unit: "ppm",
    ...(uncertainty === null ? {} : { more: `±\u2009${number(uncertainty, 2)} ms` }),
  };
}

export function stateWord({ summary, health }: Robot): string {
  if (summary.state === "lost") return TEXT.lost;
  const [first] = health.conditions;
  return first === undefined ? TEXT.live : TEXT.conditions[first];
}

export function alarmsCell({ summary }: Robot): RobotCell {
  const [errors, warnings] = [raised(summary, "error"), raised(summary, "warning")];
  if (errors + warnings > 0) return { text: number(errors + warnings, 0), tone: errors > 0 ? "bad" : "warn" };
  return summary.alarms.length > 0
    ? { text: number(summary.alarms.length, 0), more: TEXT.acknowledged }
    : { text: "0", isQuiet: true };
}

export function settingsCell({ summary: { settings, drifted } }: Robot): RobotCell {
  if (settings === "unknown") return EMPTY;
  return settings === "drifted"
    ? { text: TEXT.drifted(drifted), tone: "warn" }
    : { text: TEXT.asProfile, isQuiet: true };
}

export function diskCell({ summary }: Robot): RobotCell {
  const free = summary.disk_free_bytes;
  if (free === null) return EMPTY;
  const decimals = free < 1e10 ? 1 : 0;
  return { text: number(free / 1e9, decimals), unit: "GB", tone: hasLittleFree(summary) ? "warn" : undefined };
}

export function latencyCell({ summary }: Robot): RobotCell {
  const latency = summary.latency_ms;
  if (latency === null) return EMPTY;
  const { value, unit } = age(latency / 1000);
  return { text: value, unit };
}

export const deviceWords = (device: RobotDevice | undefined): string =>
  device === undefined ? "" : `${device.product || device.name} ${device.serial_number}`.trim();

export const fixCell = (device: RobotDevice): RobotCell =>
  device.fix === "" ? EMPTY : { text: device.fix, tone: hasNoFix(device) ? "warn" : undefined };

export const temperatureCell = ({ temperature }: RobotDevice): RobotCell =>
  temperature === null ? EMPTY : { text: number(temperature, 1), unit: "°C" };

export function cellOf(column: RobotColumn, robot: Robot): RobotCell {
  const { device, summary } = robot;
  switch (column) {
    case "alarms":
      return alarmsCell(robot);
    case "settings":
      return settingsCell(robot);
    case "disk":
      return diskCell(robot);
    case "latency":
      return latencyCell(robot);
    case "recording":
      return { text: summary.recording ? TEXT.recordingOn : "" };
    default:
      return device === undefined ? EMPTY : deviceCell(column, device);
  }
}

/** A figure of one device. */
export function deviceCell(column: RobotColumn, device: RobotDevice): RobotCell {
  switch (column) {
    case "rate":
      return rateCell(device);
    case "loss":
      return { ...lossCell(device.loss), tone: isLosing(device) ? "warn" : undefined };
    case "fix":
      return fixCell(device);
    case "temperature":
      return temperatureCell(device);
    case "clock":
      return clockCell(device);
    case "firmware":
      return device.firmware === "" ? EMPTY : { text: device.firmware };
    default:
      return { text: "" };
  }
}

const settingsKey: Readonly<Record<string, number>> = { "as-profile": 0, drifted: 1 };

export const COLUMNS: readonly Column[] = [
  column("name", false, false, ({ summary }) => summary.name),
  // the rank falls and the measure rises with urgency; a measure is far below 1e12
  column("state", false, true, ({ health }) => (CONDITIONS.length - health.rank) * 1e12 + health.measure),
  column("device", false, false, ({ device }) => deviceWords(device) || undefined),
  column("rate", true, false, ({ device }) => device?.rate),
  column("loss", true, true, ({ device }) => orNothing(device?.loss)),
  column("fix", false, true, ({ device }) =>
    device === undefined || device.fix === "" ? undefined : `${hasNoFix(device) ? 1 : 0} ${device.fix}`,
  ),
  column("temperature", true, true, ({ device }) => orNothing(device?.temperature)),
  column("clock", true, true, ({ device }) =>
    device?.clock_ppm == null ? orNothing(device?.clock_uncertainty_ms) : Math.abs(device.clock_ppm),
  ),
  column("firmware", false, false, ({ device }) => device?.firmware || undefined),
  column("settings", false, true, ({ summary: { settings, drifted } }) => {
    const known = settingsKey[settings];
    return known === undefined ? undefined : known + drifted;
  }),
  column("recording", false, true, ({ summary }) => (summary.recording ? 1 : 0)),
  column("disk", true, false, ({ summary }) => orNothing(summary.disk_free_bytes)),
  column(
    "alarms",
    true,
    true,
    ({ summary }) => 1e6 * raised(summary, "error") + 1e3 * raised(summary, "warning") + summary.alarms.length,
  ),
  column("latency", true, true, ({ summary }) => orNothing(summary.latency_ms)),
];

function column(name: RobotColumn, figures: boolean, largestFirst: boolean, key: Column["key"]): Column {
  return { name, title: TEXT.columns[name], figures, largestFirst, key };
}

export function columnNamed(name: string): Column | undefined {
  return COLUMNS.find((one) => one.name === name);
}
