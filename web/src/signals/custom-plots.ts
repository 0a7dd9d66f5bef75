/**
 * Plots that a person put together: signals of one or two units, of any devices, on one time axis. They are plain data in the view, and so is
 * what was added to a plot of a device:
 *
 *     { id: "p1", signals: [{ device: "1", channel: "Acceleration", column: "x" }, …] }      a plot of its own
 *     { id: "p2", on: { device: "1", plot: "Acceleration" }, signals: […] }                  added to that plot of the device
 *
 * A signal whose device is away stays in the list, and is drawn again when the device is back.
 */
import type { Channel } from "../data/channels";
import type { CustomPlot, SignalRef, PlotSpec, Series } from "../data/view";
import { decimalsOf } from "../ui/format/format";
import { TEXT } from "../texts/signals";

/** A signal that exists. */
export interface Found {
  readonly channel: Channel;
  readonly column: number;
}

/** Dashes and colours in turn: twelve signals look different. */
const COLOURS = ["axis-x", "axis-y", "axis-z", "axis-n"] as const;
const DASHES: readonly (readonly number[])[] = [[], [5, 3], [1.5, 2.5]];
/** A plot has a left axis and a right one. */
const MAX_UNITS = 2;
const PLOT_WEIGHT = 0.9;
const PREFIX = "custom:";

export const sameSignal = (a: SignalRef, b: SignalRef): boolean =>
  a.device === b.device && a.channel === b.channel && a.column === b.column;

/** Columns of a channel that can be plotted: flag words are lanes. */
export function plottable({ info }: Channel): readonly number[] {
  return info.kind === "table" ? [] : info.columns.flatMap(({ bits }, c) => (bits.length === 0 ? [c] : []));
}

export function signalRef({ info }: Channel, column: number): SignalRef {
  return { device: info.device, channel: info.name, column: info.columns[column]?.name ?? "" };
}

/** The signal of that name; undefined while its device is away. */
export function find(channels: readonly Channel[], { device, channel, column }: SignalRef): Found | undefined {
  const found = channels.find(({ info }) => info.device === device && info.name === channel);
  const at = found?.info.columns.findIndex(({ name }) => name === column) ?? -1;
  return found && at >= 0 ? { channel: found, column: at } : undefined;
}

export function unitOf({ channel, column }: Found): string {
  return channel.info.columns[column]?.unit || channel.info.unit;
}

/** The plots on screen: those of the device with what was added to them, then the plots of one's own. */
export function withCustomPlots(
  plots: readonly PlotSpec[],
  custom: readonly CustomPlot[],
  channels: readonly Channel[],
  device: string | undefined,
): readonly PlotSpec[] {
  if (custom.length === 0) return plots;
  const added = plots.map((plot) => {
    const extra = custom.filter(({ on }) => on !== undefined && on.device === device && on.plot === plot.key);
    const found = foundIn(
      channels,
      extra.flatMap(({ signals }) => signals),
      plot.unit,
    );
    if (found.length === 0) return plot;
    const series = [...plot.series, ...seriesOf(found, plot.series, plot.unit, plot.title)];
    return { ...plot, series, ...rightOf(plot.key, series) };
  });
  return [...added, ...custom.flatMap((one) => (one.on === undefined ? ownPlot(one, channels) : []))];
}

function foundIn(channels: readonly Channel[], signals: readonly SignalRef[], unit?: string): readonly Found[] {
  const found = signals.flatMap((one) => find(channels, one) ?? []);
  const units = new Set([...(unit === undefined ? [] : [unit]), ...found.map(unitOf)]);
  const both = [...units].slice(0, MAX_UNITS);
  return found.filter((one) => both.includes(unitOf(one))); // a device that came back may send another unit
}

/** The right axis, if some of the series need it. */
function rightOf(key: string, series: readonly Series[]): Pick<PlotSpec, "right"> {
  const own = series.filter(({ isRight }) => isRight);
  const [first] = own;
  if (first === undefined) return {};
  const decimals = Math.max(...own.map((one) => one.decimals));
  return { right: { key: `${key} right`, unit: unitOf(first), decimals } };
}

function ownPlot({ id, signals }: CustomPlot, channels: readonly Channel[]): readonly PlotSpec[] {
  const found = foundIn(channels, signals);
  if (found[0] === undefined) return [];
  const series = seriesOf(found, [], unitOf(found[0]), titleOf(found));
  const key = `${PREFIX}${id}`;
  const frames = new Set(found.map(({ channel }) => channel.info.frame.split(" ")[0] ?? ""));
  return [
    {
      key,
      title: titleOf(found),
      unit: unitOf(found[0]),
      frame: frames.size === 1 ? [...frames].join() : "",
      series,
      decimals: Math.max(0, ...series.filter(({ isRight }) => !isRight).map(({ decimals }) => decimals)),
      ...rightOf(key, series),
      weight: PLOT_WEIGHT,
      primary: false,
      group: "",
      custom: id,
    },
  ];
}

const nameOf = ({ info }: Channel): string => info.title || info.name;

function titleOf(found: readonly Found[]): string {
  return [...new Set(found.map(({ channel }) => nameOf(channel)))].join(", ");
}

/**
 * Each signal in its axis' colour, or the next one free, and each further device in dashes of its own. The device and the axis are the
 * label where several devices are together; the name of the channel is a heading where the plot's `title` is another. Those of another
 * unit than `unit` are on the right axis.
 */
function seriesOf(found: readonly Found[], beside: readonly Series[], unit: string, title: string): readonly Series[] {
  const used = new Set(beside.map(({ colour, dash }) => `${colour} ${DASHES.findIndex((one) => same(one, dash))}`));
  const channels = new Set([...beside.map(({ channel }) => channel), ...found.map(({ channel }) => channel)]);
  const devices = [...new Set([...channels].map(({ info }) => info.device))];
  return found.flatMap(({ channel, column }) => {
    const info = channel.info.columns[column];
    if (!info) return [];
    const wanted = info.axis === "" || info.axis === "w" ? undefined : (`axis-${info.axis}` as const);
    const look = nextLook(used, wanted, devices.indexOf(channel.info.device));
    used.add(`${look.colour} ${look.dash}`);
    const own = info.label || info.name;
    const heading = nameOf(channel) === title ? undefined : nameOf(channel);
    const isAlone = channel.info.columns.length === 1; // its name is that of the channel
    const label = [
      ...(devices.length === 1 ? [] : [TEXT.ofDevice(channel.info.device)]),
      ...(isAlone && heading !== undefined ? [] : [own]),
    ].join(" ");
    const series: Series = {
      channel,
      column,
      key: `${channel.info.device}/${channel.info.name}.${info.name}`,
      label,
      ...(heading === undefined ? {} : { heading }),
      mark: (isAlone ? nameOf(channel) : own).charAt(0),
      colour: look.colour,
      dash: DASHES[look.dash] ?? [],
      norm: false,
      ...(unitOf({ channel, column }) === unit ? {} : { isRight: true }),
      decimals: decimalsOf(info),
    };
    return [series];
  });
}

const same = (a: readonly number[], b: readonly number[]): boolean => a.join() === b.join();

function nextLook(
  used: ReadonlySet<string>,
  wanted: Series["colour"] | undefined,
  device: number,
): { readonly colour: Series["colour"]; readonly dash: number } {
  const dashes = DASHES.map((_, dash) => (device + dash) % DASHES.length);
  const all = (colours: readonly Series["colour"][]) =>
    dashes.flatMap((dash) => colours.map((colour) => ({ colour, dash })));
  const looks = [...(wanted ? all([wanted]) : []), ...all(COLOURS)];
  return looks.find(({ colour, dash }) => !used.has(`${colour} ${dash}`)) ?? { colour: wanted ?? "axis-n", dash: 0 };
}

// ── changes ───────────────────────────────────────────────────────────────────────────────────────────────────────────

/** Where a signal goes: a plot of one's own by its id, a plot of a device by its key, or a new plot. */
export type Target =
  | { readonly kind: "new" }
  | { readonly kind: "own"; readonly id: string }
  | { readonly kind: "device"; readonly device: string; readonly plot: string };

/** The target that is a plot on screen. */
export function targetOf({ key, custom }: PlotSpec, device: string): Target {
  return custom === undefined ? { kind: "device", device, plot: key } : { kind: "own", id: custom };
}

const isAt = ({ id, on }: CustomPlot, target: Target): boolean =>
  target.kind === "own"
    ? id === target.id
    : target.kind === "device" && on !== undefined && on.device === target.device && on.plot === target.plot;

/** With these signals on that plot too. */
export function added(
  custom: readonly CustomPlot[],
  target: Target,
  signals: readonly SignalRef[],
): readonly CustomPlot[] {
  const at = custom.findIndex((one) => isAt(one, target));
  if (at < 0) {
    const on = target.kind === "device" ? { on: { device: target.device, plot: target.plot } } : {};
    return [...custom, { id: freeId(custom), ...on, signals }];
  }
  return custom.map((one, k) => {
    if (k !== at) return one;
    const fresh = signals.filter((signal) => !one.signals.some((known) => sameSignal(known, signal)));
    return { ...one, signals: [...one.signals, ...fresh] };
  });
}

/** Without these signals on that plot; a plot without signals is gone. */
export function removed(
  custom: readonly CustomPlot[],
  target: Target,
  signals: readonly SignalRef[],
): readonly CustomPlot[] {
  return custom
    .map((one) =>
      isAt(one, target)
        ? { ...one, signals: one.signals.filter((own) => !signals.some((signal) => sameSignal(own, signal))) }
        : one,
    )
    .filter(({ signals: left }) => left.length > 0);
}

/** The signals of these that were put on that plot. */
export function heldOf(
  custom: readonly CustomPlot[],
  target: Target,
  signals: readonly SignalRef[],
): readonly SignalRef[] {
  const own = custom.filter((one) => isAt(one, target)).flatMap((one) => one.signals);
  return signals.filter((signal) => own.some((one) => sameSignal(one, signal)));
}

function freeId(custom: readonly CustomPlot[]): string {
  const taken = new Set(custom.map(({ id }) => id));
  let k = 1;
  while (taken.has(`p${k}`)) k += 1;
  return `p${k}`;
}

/** A sentence why signals of these units cannot be on that plot as well; undefined if they can. */
export function misfit(
  units: readonly string[],
  { title, unit, right }: Pick<PlotSpec, "title" | "unit" | "right">,
): string | undefined {
  const own = right ? [unit, right.unit] : [unit];
  const others = [...new Set(units)].filter((one) => !own.includes(one));
  if (own.length + others.length <= MAX_UNITS) return undefined;
  const words = (some: readonly string[]): string => some.map((one) => one || TEXT.noUnit).join(TEXT.and);
  return TEXT.otherUnit(words(others), title, words(own));
}

// ── in a link ─────────────────────────────────────────────────────────────────────────────────────────────────────────

/** One plot as a word of a link: "1/Acceleration/x,2/Acceleration/x", or "@1/Acceleration," before what was added there. */
export function plotWord({ on, signals }: CustomPlot): string {
  const word = (...parts: readonly string[]): string => parts.map((part) => encodeURIComponent(part)).join("/");
  const head = on === undefined ? [] : [`@${word(on.device, on.plot)}`];
  return [...head, ...signals.map(({ device, channel, column }) => word(device, channel, column))].join(",");
}

/** The plots of such words; what is cut or mistyped is left out. */
export function plotsOfWords(words: readonly string[]): readonly CustomPlot[] {
  return words.flatMap((text, k) => {
    try {
      const parts = text.split(",").map((word) => word.replace(/^@/, "").split("/").map(decodeURIComponent));
      const [device, plot] = text.startsWith("@") ? (parts.shift() ?? []) : [];
      const signals = parts.flatMap(([of, channel, column]) =>
        of && channel && column ? [{ device: of, channel, column }] : [],
      );
      if (signals.length === 0 || (text.startsWith("@") && !(device && plot))) return [];
      return [{ id: `p${k + 1}`, ...(device && plot ? { on: { device, plot } } : {}), signals }];
    } catch {
      return [];
    }
  });
}
