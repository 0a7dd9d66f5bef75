/** Columns of a histogram: the chosen ones, or those of the quantity that a user most likely wants to see. */
import type { Channel } from "../../data/channels";
import type { HistogramChoice } from "../../data/view";
import { type Found, plottable, unitOf } from "../../signals/custom-plots";

/** Noise is looked for in these, best first. */
const FIRST = [/^rate.?of.?turn$|gyr|angular/i, /acc/i];

/** Channels with numbers. */
export function countable(channels: readonly Channel[]): readonly Channel[] {
  return channels.filter(
    (channel) => !["status", "counter"].includes(channel.info.kind) && plottable(channel).length > 0,
  );
}

/** The channel that is shown; undefined without any. */
export function chosenChannel(channels: readonly Channel[], { channel }: HistogramChoice): Channel | undefined {
  const title = ({ info }: Channel): string => info.title || info.name;
  const usual = FIRST.map((words) => channels.find((one) => words.test(title(one)))).find((one) => one !== undefined);
  return channels.find(({ info }) => info.name === channel) ?? usual ?? channels[0];
}

/** The signals of that channel that are shown: all have one unit, and a norm is shown on request. */
export function chosenSignals(channel: Channel, { columns }: HistogramChoice): readonly Found[] {
  const all = plottable(channel).map((column): Found => ({ channel, column }));
  const name = ({ column }: Found): string => channel.info.columns[column]?.name ?? "";
  const chosen = all.filter((one) => columns?.includes(name(one)));
  if (chosen.length > 0) return sameUnit(chosen);
  const plain = all.filter((one) => name(one) !== "norm");
  return sameUnit(channel.info.kind === "record" ? plain.slice(0, 1) : plain);
}

const sameUnit = (signals: readonly Found[]): readonly Found[] =>
  signals.filter((one) => signals[0] && unitOf(one) === unitOf(signals[0]));
