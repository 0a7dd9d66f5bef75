/**
 * Channels of a device's position and its quality. Pure. A position is found by its columns (latitude, longitude), and its quality (fix,
 * carrier solution, satellites, accuracy) by theirs or by bit groups, in the same channel or in those of the same message, so that
 * messages of any family work.
 */
import type { Channel } from "../../data/channels";
import { choiceWords } from "../../ui/format/labels";
import type { BitsInfo } from "../../wire/types";
import { TEXT } from "./texts";

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

/** Receivers without a fix send the largest possible number as accuracy. */
const UNKNOWN_M = 100_000;

const FIX = /^(gps_?nav_?)?fix_?(type)?$|^gnss_?fix$/i;
const CARRIER = /carrier|rtk_?status/i;
const SATELLITES = /^(num_?sv|sats_?used)$/i;

/** The position of a device: one with its own fix is preferred; that of a base station is not the device's. */
export function positionOf(channels: readonly Channel[]): Position | undefined {
  const found = channels.flatMap((channel): readonly Position[] => {
    const { info } = channel;
    const find = (pattern: RegExp): number => info.columns.findIndex(({ name }) => pattern.test(name));
    const [lat, lon] = [find(/^lat/i), find(/^lon/i)];
    if (lat < 0 || lon < 0 || info.kind === "table" || /base|reference/i.test(info.title)) return [];
    const near = [
      channel,
      ...channels.filter((other) => other !== channel && info.group !== "" && other.info.message === info.message),
    ];
    const facet = (pattern: RegExp): Facet | undefined => facetOf(near, pattern);
    return [
      {
        channel,
        lat,
        lon,
        fix: facet(FIX),
        carrier: facet(CARRIER),
        satellites: facet(SATELLITES),
        horizontal: facet(/^h_?acc$/i),
        vertical: facet(/^v_?acc$/i),
      },
    ];
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
function valueOf(position: Position, facet: Facet | undefined, i: number): number | undefined {
  if (!facet || i < 0) return undefined;
  const own = facet.channel === position.channel;
  const k = own ? i : facet.channel.ring.indexAt(position.channel.ring.arrival(i), "arrival");
  if (k < 0) return undefined;
  const value = facet.channel.ring.value(facet.column, k);
  if (!facet.bits) return value;
  return Math.floor(value / 2 ** facet.bits.low) % 2 ** facet.bits.width;
}

/** The facet in words: "3D", "RTK fix"; "" if unknown. */
export function facetWords(position: Position, facet: Facet | undefined, i: number): string {
  const value = valueOf(position, facet, i);
  if (!facet || value === undefined) return "";
  const choices = facet.bits?.choices ?? facet.channel.info.columns[facet.column]?.choices ?? {};
  const choice = choices[String(value)];
  if (choice !== undefined) return choiceWords(choice);
  if (facet.bits?.width === 1) return value ? "fix" : TEXT.noFix;
  return String(value);
}

/** A length in metres; undefined if unknown. */
export function metresOf(position: Position, facet: Facet | undefined, i: number): number | undefined {
  const value = valueOf(position, facet, i);
  if (!facet || value === undefined) return undefined;
  const size = facet.channel.info.columns[facet.column]?.unit === "mm" ? value / 1000 : value;
  return size < UNKNOWN_M ? size : undefined;
}

/** Line style of a fix: none, dotted, thin, dashed, thick. */
export type Quality = "none" | "poor" | "plain" | "float" | "fixed";

/** The quality given by the words of a fix and of a carrier solution. */
export function qualityOf(fix: string, carrier: string): Quality {
  if (/^(none|no fix|no solution|time only)/i.test(fix)) return "none";
  if (/rtk.?fix/i.test(fix) || /fixed/i.test(carrier)) return "fixed";
  if (/float/i.test(fix) || /float/i.test(carrier)) return "float";
  return /2d|dead.?reck/i.test(fix) && !/gps plus|3d/i.test(fix) ? "poor" : "plain";
}

/** The fix in one line: "3D · RTK floating · 17 sat". */
export function fixLine(position: Position, i: number): string {
  const carrier = facetWords(position, position.carrier, i);
  const rtk = carrier === "" || /^(none|no rtk)$/i.test(carrier) ? "" : TEXT.rtk(carrier);
  const satellites = valueOf(position, position.satellites, i);
  return [facetWords(position, position.fix, i), rtk, satellites === undefined ? "" : TEXT.satelliteCount(satellites)]
    .filter(Boolean)
    .join(" · ");
}

/** Whether a position is plausible: a receiver without a fix sends zeros or nonsense. */
export function isPlace(lat: number, lon: number): boolean {
  return Number.isFinite(lat + lon) && (lat !== 0 || lon !== 0) && Math.abs(lat) <= 90 && Math.abs(lon) <= 360;
}
