/**
 * Which of a device's channels say where it is, and how well? Pure. A position is found by its columns (latitude, longitude), and
 * what is known of it (fix, carrier solution, satellites, accuracy) by theirs or by bit groups, in the same channel or in those
 * of the same message, so that any family's message will do.
 */
import type { Channel } from "../data/channels";
import { choiceWords } from "../ui/labels";
import type { BitsInfo } from "../wire/types";

/** One number of one channel, or one bit group of it. */
export interface Facet {
  readonly channel: Channel;
  readonly column: number;
  readonly bits: BitsInfo | undefined;
}

export interface Position {
  readonly channel: Channel;
  readonly lat: number;
  readonly lon: number;
  readonly fix: Facet | undefined;
  readonly carrier: Facet | undefined;
  readonly satellites: Facet | undefined;
  readonly horizontal: Facet | undefined;
  readonly vertical: Facet | undefined;
}

/** Receivers without a fix send the largest number there is for an accuracy. */
const UNKNOWN_M = 100_000;

const FIX = /^(gps_?nav_?)?fix_?(type)?$|^gnss_?fix$/i;
const CARRIER = /carrier|rtk_?status/i;
const SATELLITES = /^(num_?sv|sats_?used)$/i;

/** The position of a device: one that tells its own fix is preferred; that of a base station is not the device's. */
export function positionOf(channels: readonly Channel[]): Position | undefined {
  const found = channels.flatMap((channel): readonly Position[] => {
    const { info } = channel;
    const find = (pattern: RegExp): number => info.columns.findIndex(({ name }) => pattern.test(name));
    const [lat, lon] = [find(/^lat/i), find(/^lon/i)];
    if (lat < 0 || lon < 0 || info.kind === "rows" || /base|reference/i.test(info.title)) return [];
    const near = [channel, ...channels.filter((other) => other !== channel && info.group !== "" && other.info.message === info.message)];
    const facet = (pattern: RegExp): Facet | undefined => facetOf(near, pattern);
    return [{ channel, lat, lon, fix: facet(FIX), carrier: facet(CARRIER), satellites: facet(SATELLITES), horizontal: facet(/^h_?acc$/i), vertical: facet(/^v_?acc$/i) }];
  });
  const best = found.find(({ fix, horizontal }) => fix && horizontal) ?? found.find(({ fix }) => fix) ?? found[0];
  if (best === undefined || best.fix) return best;
  const status = channels.filter(({ info }) => info.kind === "status");
  return { ...best, fix: facetOf(status, FIX), carrier: best.carrier ?? facetOf(status, CARRIER) };
}

/** The first column of that name, else the first bit group. */
function facetOf(channels: readonly Channel[], pattern: RegExp): Facet | undefined {
  for (const channel of channels) {
    const column = channel.info.columns.findIndex(({ name }) => pattern.test(name));
    if (column >= 0) return { channel, column, bits: undefined };
  }
  for (const channel of channels) {
    for (const [column, { bits: groups }] of channel.info.columns.entries()) {
      const bits = groups.find(({ name }) => pattern.test(name));
      if (bits) return { channel, column, bits };
    }
  }
  return undefined;
}

/** The facet's value when the position had sample `i`; undefined where there is none. */
export function valueOf(position: Position, facet: Facet | undefined, i: number): number | undefined {
  if (!facet || i < 0) return undefined;
  const own = facet.channel === position.channel;
  const k = own ? i : facet.channel.ring.indexAt(position.channel.ring.arrival(i), "arrival");
  if (k < 0) return undefined;
  const value = facet.channel.ring.value(facet.column, k);
  if (!facet.bits) return value;
  return Math.floor(value / 2 ** facet.bits.low) % 2 ** facet.bits.width;
}

/** The facet in words: "3D", "RTK fix"; "" where it is not told. */
export function wordsOf(position: Position, facet: Facet | undefined, i: number): string {
  const value = valueOf(position, facet, i);
  if (!facet || value === undefined) return "";
  const choices = facet.bits?.choices ?? facet.channel.info.columns[facet.column]?.choices ?? {};
  const choice = choices[String(value)];
  if (choice !== undefined) return choiceWords(choice);
  if (facet.bits?.width === 1) return value ? "fix" : "no fix";
  return String(value);
}

/** A length in metres; undefined where it is not known. */
export function metresOf(position: Position, facet: Facet | undefined, i: number): number | undefined {
  const value = valueOf(position, facet, i);
  if (!facet || value === undefined) return undefined;
  const size = facet.channel.info.columns[facet.column]?.unit === "mm" ? value / 1000 : value;
  return size < UNKNOWN_M ? size : undefined;
}

/** How a fix is drawn: not at all, dotted, thin, dashed, thick. */
export type Quality = "none" | "poor" | "plain" | "float" | "fixed";

/** The quality that the words of a fix and of a carrier solution tell. */
export function qualityOf(fix: string, carrier: string): Quality {
  if (/^(none|no fix|no solution|time only)/i.test(fix)) return "none";
  if (/rtk.?fix/i.test(fix) || /fixed/i.test(carrier)) return "fixed";
  if (/float/i.test(fix) || /float/i.test(carrier)) return "float";
  return /2d|dead.?reck/i.test(fix) && !/gps plus|3d/i.test(fix) ? "poor" : "plain";
}

/** What is known of the fix in one line: "3D · RTK floating · 17 sat". */
export function fixLine(position: Position, i: number): string {
  const carrier = wordsOf(position, position.carrier, i);
  const rtk = carrier === "" || /^(none|no rtk)$/i.test(carrier) ? "" : `RTK ${carrier}`;
  const satellites = valueOf(position, position.satellites, i);
  return [wordsOf(position, position.fix, i), rtk, satellites === undefined ? "" : `${satellites} sat`].filter(Boolean).join(" · ");
}

/** True for what can be a place: a receiver without a fix sends zeros or nonsense. */
export function isPlace(lat: number, lon: number): boolean {
  return Number.isFinite(lat + lon) && (lat !== 0 || lon !== 0) && Math.abs(lat) <= 90 && Math.abs(lon) <= 360;
}
