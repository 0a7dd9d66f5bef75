/**
 * Order and groups of the values. Pure: channels in, groups of rows out.
 *
 * Quantities with axes come first, in an engineer's reading order; slow ones are one group of single lines at the end; a record
 * (GNSS) is a group of its own. Tables with several rows at one time (satellites) are only counted here.
 */
import { titlesOf } from "../ui/format/labels";
import type { ChannelInfo, ColumnInfo } from "../wire/types";
import { TEXT } from "../texts/panels";

const ORDER: readonly string[] = [
  "Acceleration",
  "FreeAcceleration",
  "AccelerationHR",
  "RateOfTurn",
  "RateOfTurnHR",
  "MagneticField",
  "EulerAngles",
  "Quaternion",
  "RotationMatrix",
  "VelocityXYZ",
  "DeltaV",
  "DeltaQ",
  "PositionEcef",
];

export interface ValueRow {
  readonly channel: ChannelInfo;
  /** Index among the channel's columns; -1 for a table of rows. */
  readonly column: number;
  readonly info: ColumnInfo | undefined;
  readonly label: string;
  /** Beside the label, where the group has none of its own. */
  readonly unit?: string;
  /** "x", "y", "z" for an axis colour, "n" for none, "" for a plain line with its unit and no statistics. */
  readonly colour: "x" | "y" | "z" | "n" | "";
}

export interface ValueGroup {
  readonly title: string;
  readonly unit: string;
  readonly frame: string;
  readonly rows: readonly ValueRow[];
  /** False: shown although the sender could not be verified. */
  readonly verified: boolean;
}

/** The same quantities by titles shared with families that use other names. */
const TITLES: readonly string[] = [
  "Acceleration",
  "Rate of turn",
  "Magnetic field",
  "Euler angles",
  "Quaternion",
  "Velocity",
  "Position",
];

function rank(channel: ChannelInfo): number {
  const at = ORDER.indexOf(channel.name);
  if (at >= 0) return at;
  const title = TITLES.indexOf(channel.title);
  const same =
    title < 0 ? -1 : ORDER.findIndex((name) => name.toLowerCase() === channel.title.replaceAll(" ", "").toLowerCase());
  if (same >= 0) return same;
  return ORDER.length + (title < 0 ? TITLES.length : title);
}

/** Columns reserved by the document: nothing to read. */
const RESERVED = /^res(erved)?\d*$/i;

function rowsOf(channel: ChannelInfo, plain: boolean): readonly ValueRow[] {
  return channel.columns.flatMap((info, column): readonly ValueRow[] => {
    if (RESERVED.test(info.name)) return [];
    const colour = info.axis === "x" || info.axis === "y" || info.axis === "z" ? info.axis : "n";
    return [{ channel, column, info, label: info.label || info.name, colour: plain ? "" : colour }];
  });
}

export function valueGroups(channels: readonly ChannelInfo[]): readonly ValueGroup[] {
  const groups: ValueGroup[] = [];
  const slow: ValueRow[] = [];
  const records: ValueGroup[] = [];
  const titleOf = titlesOf(channels);
  for (const channel of [...channels].sort((a, b) => rank(a) - rank(b))) {
    const title = titleOf(channel);
    const { frame } = channel;
    if (channel.kind === "table") {
      slow.push({ channel, column: -1, info: undefined, label: title, colour: "" });
    } else if (["vector", "euler", "quaternion", "matrix"].includes(channel.kind)) {
      groups.push({
        title,
        unit: channel.unit || commonUnit(channel),
        frame,
        rows: rowsOf(channel, false),
        verified: channel.verified,
      });
    } else if (channel.columns.length === 1) {
      // A quantity by itself has a mean and a spread as one with axes has: a gyro of a table, a temperature.
      const measured = channel.kind === "scalar" && channel.columns[0]!.dtype.startsWith("f");
      for (const row of rowsOf(channel, !measured))
        slow.push({ ...row, label: title, ...(measured ? { unit: row.info?.unit || channel.unit } : {}) });
    } else {
      records.push({ title, unit: "", frame, rows: rowsOf(channel, true), verified: channel.verified });
    }
  }
  const tail =
    slow.length > 0
      ? [
          {
            title: TEXT.otherValues,
            unit: "",
            frame: "",
            rows: slow,
            verified: slow.every((row) => row.channel.verified),
          },
        ]
      : [];
  return [...groups, ...tail, ...records];
}

/** The unit that all columns share; "" when they differ. */
function commonUnit(channel: ChannelInfo): string {
  const first = channel.columns[0]?.unit ?? "";
  return channel.columns.every((column) => column.unit === first) ? first : "";
}
