/**
 * Signals as the server is asked for them.
 *
 * The server knows signals as their device sends them. A column shown in another frame is computed from those: one column with
 * another sign or direction is asked for and changed here, any other combination is asked for as an expression.
 */
import type { Channel } from "../data/channels";
import type { FrameChange } from "../data/frames";
import type { TimeBase, Series } from "../data/view";

export interface MeasuredRange {
  readonly t0: number;
  readonly t1: number;
  readonly base: TimeBase;
}

/** The recording or device that is asked, and how its signals are shown. */
export interface FigureSource {
  /** Id of the recording or the device. */
  readonly id: string;
  /** Put before names of signals: "2/" if it has several devices, "Imu6/" if several messages have a channel of that name. */
  readonly prefix: (sent: Channel["info"]) => string;
  /** The channel under that id as it was sent. */
  readonly sent: (id: number) => Channel["info"] | undefined;
  /** From the sent to the displayed form. */
  readonly changeOf: (id: number) => FrameChange | undefined;
}

/** How a displayed column is asked for. */
export interface Wanted {
  /** Signal or expression. */
  readonly word: string;
  /** Signals that the answer has for that word, and which of them it is. */
  readonly parts: number;
  readonly part: number;
  readonly factor: number;
  readonly offset: number;
  readonly period: number;
}

const EULER = ["roll", "pitch", "yaw"];

/** How a series is asked for; undefined: the server cannot compute it. */
export function wantedOf(
  { channel: { info }, column }: Pick<Series, "channel" | "column">,
  source: FigureSource,
): Wanted | undefined {
  const shown = info.columns[column];
  const sent = source.sent(info.id < 0 ? -1 - info.id : info.id);
  if (shown === undefined || sent === undefined) return undefined;
  // a plot may have signals of another source, whose ids mean other channels here
  if (sent.device !== info.device || (info.id >= 0 && sent.name !== info.name)) return undefined;
  const name = source.prefix(sent) + sent.name;
  const plain = { parts: 1, part: 0, factor: 1, offset: 0, period: shown.period };
  if (info.id < 0) {
    const part = EULER.indexOf(shown.name);
    const isSame = sent.kind === "quaternion" && source.changeOf(sent.id) === undefined;
    return isSame && part >= 0 ? { ...plain, word: `euler("${name}")`, parts: EULER.length, part } : undefined;
  }
  if (shown.name === "norm" && column >= sent.columns.length) return { ...plain, word: `norm("${name}")` };
  const row = source.changeOf(info.id)?.[column];
  const own = (k: number): string => `${name}.${sent.columns[k]?.name}`;
  if (row === undefined) return { ...plain, word: own(column) };
  const [only, more] = row.terms;
  if (only !== undefined && more === undefined)
    return { ...plain, word: own(only[0]), factor: only[1], offset: row.offset };
  if (row.offset !== 0) return undefined;
  return { ...plain, word: row.terms.map(([k, factor]) => `(${factor}) * "${own(k)}"`).join(" + ") };
}
