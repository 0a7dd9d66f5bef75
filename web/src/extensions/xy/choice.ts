/** The two signals of an XY plot: those that were chosen, or those that a device most likely has it for. */
import type { Channel } from "../../data/channels";
import type { ColumnName, XyChoice } from "../../data/view";
import { type Found, plottable, unitOf } from "../../signals/custom-plots";

/** Channels whose first two axes show something over each other, best first. */
const FIRST = [/mag/i, /^(local )?position$/i, /acc/i];

export const columnName = ({ channel, column }: Found): ColumnName => [
  channel.info.name,
  channel.info.columns[column]?.name ?? "",
];

/** Every signal of these channels that can be plotted. */
export function plottableOf(channels: readonly Channel[]): readonly Found[] {
  return channels
    .filter(({ info }) => info.kind !== "status" && info.kind !== "counter")
    .flatMap((channel) => plottable(channel).map((column) => ({ channel, column })));
}

export function foundAs(signals: readonly Found[], name: ColumnName | undefined): Found | undefined {
  if (name === undefined) return undefined;
  return signals.find(
    ({ channel: { info }, column }) => info.name === name[0] && info.columns[column]?.name === name[1],
  );
}

/** What is shown of these signals; undefined without two. */
export function chosenPair(
  signals: readonly Found[],
  { x, y }: XyChoice,
): { readonly x: Found; readonly y: Found } | undefined {
  const [a, b] = usualPair(signals);
  const [chosenX, chosenY] = [foundAs(signals, x) ?? a, foundAs(signals, y) ?? b];
  return chosenX && chosenY ? { x: chosenX, y: chosenY } : undefined;
}

function usualPair(signals: readonly Found[]): readonly Found[] {
  const vectors = signals.filter(({ channel: { info } }) => info.kind === "vector");
  for (const words of FIRST) {
    const own = vectors.filter(({ channel: { info } }) => words.test(info.title || info.name));
    const pair = own.filter(({ channel }) => channel === own[0]?.channel);
    if (pair.length >= 2) return pair;
  }
  return signals;
}

/** "Magnetic field y". */
export function signalName({ channel: { info }, column }: Found): string {
  const title = info.title || info.name;
  if (info.columns.length === 1) return title;
  return `${title} ${info.columns[column]?.label || info.columns[column]?.name || ""}`;
}

/** "Magnetic field y (µT)". */
export function nameWithUnit(found: Found): string {
  const unit = unitOf(found);
  return unit === "" ? signalName(found) : `${signalName(found)} (${unit})`;
}
