/**
 * The plots of a device, their order, and which of them are shown initially.
 *
 * The device's protocol may define them. Otherwise this rule applies: acceleration, rate of turn, magnetic field, roll with pitch, and
 * yaw are shown, one of each family, and velocity and local position for a device that knows them; title and unit decide the family,
 * not a protocol's own names. Every other number with a unit is offered under the plots and added with one click. A device that
 * sends none of the five shows its first few quantities. Angles of different size never share a y scale; neither do units.
 */
import type { Series, PlotSpec } from "../data/view";
import type { Channel } from "../data/channels";
import type { ColumnInfo } from "../wire/types";
import { decimalsOf } from "../ui/format/format";
import { TEXT } from "../texts/plots";

interface Family {
  /** Of the channel's title, or its name. */
  readonly words: RegExp;
  /** Possible units; "" if devices give none. */
  readonly units: readonly string[];
  readonly weight: number;
}

const ACCELERATION: readonly string[] = ["m/s²", "g"];
const TURN: readonly string[] = ["°/s", "rad/s"];

/** In the design's order. The first channel of a family is the one shown. */
const FAMILIES: readonly Family[] = [
  { words: /^acceleration$/i, units: ACCELERATION, weight: 1.2 },
  { words: /acc/i, units: ACCELERATION, weight: 1.2 },
  { words: /^rate.?of.?turn$|gyr|angular.?(rate|vel)/i, units: TURN, weight: 1.14 },
  { words: /rate.?of.?turn/i, units: TURN, weight: 1.14 },
  { words: /^(?!.*bias).*mag/i, units: ["a.u.", "µT", "G", "gauss", ""], weight: 1.02 },
];
/** After the angles: quantities of devices that also know their position. */
const MOTION: readonly Family[] = [
  { words: /^velocity(?!.*increment)/i, units: ["m/s"], weight: 0.9 },
  { words: /^(local )?position$/i, units: ["m"], weight: 0.9 },
];
/** Preferred frames for motion, best first. */
const MOTION_FRAMES: readonly RegExp[] = [/^(ENU|NED|NWU)/, /^(body|FLU|FRD)?$/, /^ECEF/];
/** Families that are equivalent: the second member is offered, not shown. */
const SAME: readonly number[] = [0, 0, 1, 1, 2];
const EULER = { tilt: 0.98, yaw: 0.66 };
const OTHER_WEIGHT = 0.9;
/** Number of plots of a device that sends none of the design's quantities. */
const FALLBACK = 4;
/** Offered per record: a GNSS fix has thirty numbers, too many for a row of buttons. */
const MAX_OF_RECORD = 8;
const SERIES_IN_PLOT = 3;
/** Times, counts and reserved fields: never plotted. */
const NOT_PLOTTED =
  /^(itow|tow|year|month|day|hour|min(ute)?|sec(ond)?|nano|ns|week|time|timeOfWeek(Ms)?|leapS|res(erved)?\d*|t_?acc)$/i;
const DASHES: readonly (readonly number[])[] = [[], [5, 3], [1.5, 2.5]];

const COLOURS = { x: "axis-x", y: "axis-y", z: "axis-z", w: "axis-n", "": "axis-n" } as const;

function seriesOf(channel: Channel, columns: readonly number[]): Series[] {
  let plain = 0;
  return columns.map((column) => {
    const info = channel.info.columns[column]!;
    const norm = info.name === "norm" && channel.info.kind === "vector";
    const colour = COLOURS[info.axis];
    const dash = colour === "axis-n" && !norm ? DASHES[plain++ % DASHES.length]! : [];
    const label = info.label || info.name;
    return {
      channel,
      column,
      key: `${channel.info.name}.${info.name}`,
      label,
      colour,
      dash,
      norm,
      decimals: decimalsOf(info),
    };
  });
}

function spec(
  channel: Channel,
  key: string,
  title: string,
  columns: readonly number[],
  weight: number,
  primary: boolean,
): PlotSpec {
  const series = seriesOf(channel, columns);
  const unit = channel.info.columns[columns[0]!]!.unit || channel.info.unit;
  const decimals = Math.max(0, ...series.map((one) => one.decimals));
  return {
    key: `${channel.info.name}${key}`,
    title,
    unit,
    frame: channel.info.frame.split(" ")[0] ?? "", // "ENU from body" and "ENU" are both ENU to the reader
    series,
    decimals,
    weight,
    primary,
    group: channel.info.group,
  };
}

function whole(channel: Channel, weight: number, primary: boolean): PlotSpec {
  const columns = channel.info.columns.map((_, c) => c);
  return spec(channel, "", title(channel), columns, weight, primary);
}

function title(channel: Channel): string {
  return channel.info.title || channel.info.name;
}

function eulerPlots(channel: Channel): PlotSpec[] {
  const find = (name: string): number => channel.info.columns.findIndex((column) => column.name === name);
  const [roll, pitch, yaw] = [find("roll"), find("pitch"), find("yaw")];
  if (roll < 0 || pitch < 0 || yaw < 0) return [whole(channel, EULER.tilt, true)];
  return [
    spec(channel, "/tilt", TEXT.rollPitch, [roll, pitch], EULER.tilt, true),
    spec(channel, "/yaw", TEXT.yaw, [yaw], EULER.yaw, true),
  ];
}

function isNumber(column: ColumnInfo): boolean {
  return column.bits.length === 0 && Object.keys(column.choices).length === 0 && !NOT_PLOTTED.test(column.name);
}

/** A record, or a vector without axes: columns with the same unit and the same start of the name share a plot. */
function loosePlots(channel: Channel): PlotSpec[] {
  const groups = new Map<string, number[]>();
  channel.info.columns.forEach((column, c) => {
    if (!isNumber(column) || (column.unit === "" && channel.info.kind === "record")) return;
    // Axes of one vector share a scale; latitude and longitude, height and accuracy do not.
    const numbered = /^\d+$/.test(column.name); // elements without names of their own
    const group = numbered
      ? `# ${Math.floor(Number(column.name) / SERIES_IN_PLOT)}`
      : column.axis === ""
        ? `${column.name}`
        : `${column.unit} ${column.name.replace(/[a-z0-9]$/i, "")}`;
    groups.set(group, [...(groups.get(group) ?? []), c]);
  });
  const alone = groups.size === 1;
  return [...groups.values()].slice(0, MAX_OF_RECORD).map((columns) => {
    const first = channel.info.columns[columns[0]!]!;
    const name = columns.length > 1 ? first.name.replace(/_?[a-z0-9]$/i, "") : first.label || first.name;
    const numbers = columns.map((c) => channel.info.columns[c]!.name).filter((own) => /^\d+$/.test(own));
    const words = alone
      ? title(channel)
      : numbers.length > 0
        ? `${title(channel)} ${numbers.join(", ")}`
        : sentence(name);
    return spec(channel, alone ? "" : `/${first.name}`, words, columns.slice(0, SERIES_IN_PLOT), OTHER_WEIGHT, false);
  });
}

function sentence(name: string): string {
  return `${name.charAt(0).toUpperCase()}${name.slice(1)}`;
}

function otherPlots(channel: Channel): PlotSpec[] {
  const { kind } = channel.info;
  if (hasAxes(channel)) return [whole(channel, OTHER_WEIGHT, false)];
  return kind === "vector" || kind === "scalar" || kind === "record" ? loosePlots(channel) : [];
}

function belongs({ info }: Channel, { words, units }: Family): boolean {
  const unit = info.unit || (info.columns[0]?.unit ?? "");
  return (
    info.kind === "vector" &&
    units.includes(unit) &&
    (words.test(info.title) || words.test(info.name)) &&
    info.columns.some(({ axis }) => axis === "x")
  );
}

/** The velocity of an INS or a GNSS receiver; its position too, unless latitude and longitude draw a track. */
function motionPlots(channels: readonly Channel[]): PlotSpec[] {
  const tracked = channels.some(({ info }) => info.columns.some(({ name }) => /^lat/i.test(name)));
  return MOTION.slice(0, tracked ? 1 : 2).flatMap((family) => {
    const members = channels.filter((channel) => belongs(channel, family));
    const [found] = MOTION_FRAMES.flatMap((frame) => members.filter(({ info }) => frame.test(info.frame)));
    return found === undefined ? [] : [whole(found, family.weight, true)];
  });
}

/** Add the message to the titles of plots that share one; initially shown plots keep the short title. */
function toldApart(plots: readonly PlotSpec[]): PlotSpec[] {
  const seen = new Map<string, number>();
  for (const plot of plots) seen.set(plot.title, (seen.get(plot.title) ?? 0) + 1);
  const same = ({ title, group, primary }: PlotSpec): boolean => !primary && group !== "" && (seen.get(title) ?? 0) > 1;
  return plots.map((plot) => (same(plot) ? { ...plot, title: `${plot.title} · ${plot.group}` } : plot));
}

/**
 * The plots of one device's channels, those shown initially first.
 *
 * @param chosen titles or names of the initially shown quantities, given by its protocol; by default those of the rule above
 */
export function usualPlots(channels: readonly Channel[], chosen: readonly string[] = []): PlotSpec[] {
  const plots = plotsByRule(channels);
  const rank = ({ series }: PlotSpec): number =>
    chosen.findIndex((name) => series.some(({ channel }) => name === channel.info.name || name === title(channel)));
  const first = plots.filter((plot) => rank(plot) >= 0).sort((a, b) => rank(a) - rank(b));
  if (first.length === 0) return plots;
  return [
    ...first.map((plot) => ({ ...plot, primary: true })),
    ...plots.filter((plot) => rank(plot) < 0).map((plot) => ({ ...plot, primary: false })),
  ];
}

function plotsByRule(channels: readonly Channel[]): PlotSpec[] {
  const taken = new Set<Channel>();
  const shown: PlotSpec[] = [];
  const families = new Set<number>();
  FAMILIES.forEach((family, f) => {
    const found = channels.find((channel) => !taken.has(channel) && belongs(channel, family));
    if (found === undefined || families.has(SAME[f]!)) return;
    families.add(SAME[f]!);
    taken.add(found);
    shown.push(whole(found, family.weight, true));
  });
  const euler = channels.find(({ info }) => info.kind === "euler");
  if (euler !== undefined) {
    taken.add(euler);
    shown.push(...eulerPlots(euler));
  }
  const motion = motionPlots(channels);
  for (const { series } of motion) taken.add(series[0]!.channel);
  shown.push(...motion);
  const rest = channels.filter((channel) => !taken.has(channel));
  if (shown.length > 0) return toldApart([...shown, ...rest.flatMap(otherPlots)]);
  // of a table whose units are not known: what has axes is looked at first
  const [vectors, others] = [rest.filter(hasAxes), rest.filter((channel) => !hasAxes(channel))];
  const plots = [...vectors, ...others].flatMap(otherPlots);
  return toldApart(plots.map((plot, k) => ({ ...plot, primary: k < FALLBACK })));
}

function hasAxes({ info: { kind, columns } }: Channel): boolean {
  return kind === "quaternion" || (kind === "vector" && columns.some(({ axis }) => axis === "x"));
}

/** A series by its channel, if the plot's title does not tell it, and its label. */
export function labelOf({ heading, label }: Series): string {
  return [heading ?? "", label].filter((word) => word !== "").join(" ");
}

export function plain({ series }: PlotSpec): readonly string[] {
  return series.filter(({ norm }) => !norm).map(({ key }) => key);
}

/** Whether a plot of `b` would draw the same samples, in the same frame, as one of `a`. */
export function sameSeries(a: PlotSpec, b: PlotSpec): boolean {
  return (
    a.key === b.key &&
    a.frame === b.frame &&
    a.right?.unit === b.right?.unit &&
    a.series.length === b.series.length &&
    a.series.every(({ channel, key }, k) => channel.ring === b.series[k]!.channel.ring && key === b.series[k]!.key)
  );
}
