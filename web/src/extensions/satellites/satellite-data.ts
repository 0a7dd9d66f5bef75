/**
 * Received satellites, their strength and use. Pure: the newest table of a channel of rows, grouped by constellation. A table is
 * recognised by its columns: a signal strength (C/N0), a satellite number, a constellation, and the bits for use and health, of any
 * family.
 */
import type { Channel } from "../../data/channels";
import type { BitsInfo } from "../../wire/types";
import { TEXT } from "./texts";

/** "used" in the solution · "healthy", tracked and not used · "unhealthy" · "not used", without further knowledge. */
export type Use = "used" | "healthy" | "not used" | "unhealthy";

export interface Satellite {
  /** "G12". */
  readonly id: string;
  /** C/N0, dB-Hz. */
  readonly strength: number;
  readonly use: Use;
}

export interface Constellation {
  readonly name: string;
  readonly satellites: readonly Satellite[];
}

/** A channel whose rows are satellites, and the positions of its columns. */
export interface SkyTable {
  readonly channel: Channel;
  readonly strength: number;
  readonly satellite: number;
  readonly system: number;
  /** −1 where rows are satellites; else a satellite has a row for each signal. */
  readonly signal: number;
  readonly flags: number;
  readonly used: BitsInfo | undefined;
  readonly health: BitsInfo | undefined;
}

/** Constellations by their names in documents, with the letter of RINEX. */
const SYSTEMS: readonly (readonly [words: RegExp, letter: string, name: string])[] = [
  [/^gps/i, "G", "GPS"],
  [/^gal/i, "E", "Galileo"],
  [/^glo/i, "R", "GLONASS"],
  [/^bei/i, "C", "BeiDou"],
  [/^qzs/i, "J", "QZSS"],
  [/^sb/i, "S", "SBAS"],
  [/^(irn|nav)/i, "I", "NavIC"],
  [/^ime/i, "M", "IMES"],
];
/** The weakest use last. */
const ORDER: readonly Use[] = ["used", "healthy", "not used", "unhealthy"];
/** A table has no more rows than this: satellites times signals. */
const MAX_ROWS = 200;

/** The tables of satellites among a device's channels; those of signals only if there is none of satellites. */
export function skyTables(channels: readonly Channel[]): readonly SkyTable[] {
  const found = channels.flatMap((channel): readonly SkyTable[] => {
    if (channel.info.kind !== "table") return [];
    const { columns } = channel.info;
    const find = (pattern: RegExp): number => columns.findIndex(({ name }) => pattern.test(name));
    const [strength, satellite, system] = [find(/^c_?\/?n_?[o0]/i), find(/^sv_?id$/i), find(/^gnss_?id$/i)];
    if (strength < 0 || satellite < 0) return [];
    const flags = columns.findIndex(({ bits }) => bits.some(({ name }) => /^used/i.test(name)));
    const bits = columns[flags]?.bits ?? [];
    const [used, health] = [
      bits.find(({ name }) => /^used/i.test(name)),
      bits.find(({ name }) => /^health/i.test(name)),
    ];
    return [{ channel, strength, satellite, system, signal: find(/^sig_?id$/i), flags, used, health }];
  });
  const satellites = found.filter(({ signal }) => signal < 0);
  return satellites.length > 0 ? satellites : found;
}

/** The table whose last row is `i`: rows that came at one time; [] if there is none. */
export function skyAt(table: SkyTable, i: number): readonly Constellation[] {
  const { ring } = table.channel;
  if (i < 0) return [];
  const arrival = ring.arrival(i);
  const groups = new Map<string, Map<string, Satellite>>();
  const seen = new Set<string>();
  for (let k = i; k >= 0 && k > i - MAX_ROWS && ring.arrival(k) === arrival; k--) {
    const [letter, name] = systemOf(table, k);
    const id = `${letter}${String(ring.value(table.satellite, k)).padStart(2, "0")}`;
    const row = `${id} ${table.signal < 0 ? "" : ring.value(table.signal, k)}`;
    if (seen.has(row)) break; // two tables came in one chunk
    seen.add(row);
    const group = groups.get(name) ?? new Map<string, Satellite>();
    groups.set(name, group);
    const one = { id, strength: ring.value(table.strength, k), use: usageOf(table, k) };
    const other = group.get(id);
    group.set(id, other ? better(one, other) : one);
  }
  const rank = (name: string): number => SYSTEMS.findIndex(([, , known]) => known === name) + 1 || SYSTEMS.length + 1;
  return [...groups]
    .sort(([a], [b]) => rank(a) - rank(b))
    .map(([name, group]) => ({ name, satellites: [...group.values()].sort((a, b) => a.id.localeCompare(b.id)) }));
}

/** Of two signals of one satellite, the stronger strength and the better use. */
function better(a: Satellite, b: Satellite): Satellite {
  const use = ORDER.indexOf(a.use) < ORDER.indexOf(b.use) ? a.use : b.use;
  return { id: a.id, strength: Math.max(a.strength, b.strength), use };
}

function systemOf({ channel, system }: SkyTable, k: number): readonly [letter: string, name: string] {
  if (system < 0) return ["", TEXT.satellites];
  const number = channel.ring.value(system, k);
  const words = channel.info.columns[system]?.choices[String(number)] ?? TEXT.system(number);
  const known = SYSTEMS.find(([pattern]) => pattern.test(words));
  return known ? [known[1], known[2]] : ["", words];
}

function usageOf({ channel, flags, used, health }: SkyTable, k: number): Use {
  if (flags < 0) return "not used";
  const word = channel.ring.value(flags, k);
  const of = (bits: BitsInfo | undefined): number => (bits ? Math.floor(word / 2 ** bits.low) % 2 ** bits.width : 0);
  if (of(used) === 1) return "used";
  const state = health?.choices[String(of(health))] ?? "";
  if (/^(un|bad)/i.test(state) && !/^unknown/i.test(state)) return "unhealthy";
  return /^(healthy|good)/i.test(state) ? "healthy" : "not used";
}

/** "8 used · 3 healthy · 1 not used": how many satellites of each use. */
export function satelliteTally(satellites: readonly Satellite[]): string {
  const counts = ORDER.map((use) => [use, satellites.filter((one) => one.use === use).length] as const);
  return counts
    .filter(([, n]) => n > 0)
    .map(([use, n]) => `${n} ${use}`)
    .join(" · ");
}
