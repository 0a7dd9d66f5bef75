import { describe, expect, it } from "vitest";
import type { Channel } from "../../data/channels";
import type { BitsInfo } from "../../wire/types";
import { skyAt, skyTables, satelliteTally } from "./satellite-data";

const bit = (name: string, low: number, width: number, choices: Record<string, string> = {}): BitsInfo => ({
  name,
  low,
  width,
  choices,
  severity: "",
  normal_set: false,
  doc: "",
});
/** A channel of satellites; each row has its values and its arrival time. */
function table(
  flags: readonly BitsInfo[],
  systems: Record<string, string>,
  rows: readonly (readonly [at: number, gnss: number, sv: number, cno: number, word: number, signal?: number])[],
): Channel {
  const signals = rows.some((row) => row.length > 5);
  const columns = [
    ["gnssId", systems],
    ["svId", {}],
    ["cno", {}],
    ["flags", {}],
    ...(signals ? [["sigId", {}]] : []),
  ].map(([name, choices]) => ({
    name,
    choices,
    bits: name === "flags" ? flags : [],
  }));
  const ring = {
    length: rows.length,
    arrival: (i: number) => rows[i]![0],
    value: (c: number, i: number) => rows[i]![(c + 1) as 1],
  };
  return { info: { kind: "table", columns }, ring } as unknown as Channel;
}
const XSENS = [
  bit("Quality", 0, 3),
  bit("UsedForNavigation", 3, 1),
  bit("Health", 4, 2, { 0: "unknown", 1: "healthy", 2: "unhealthy" }),
];
const INERTIAL = [bit("USED_IN_SOLUTION", 3, 1), bit("HEALTH", 4, 2, { 0: "UNKNOWN", 1: "GOOD", 2: "BAD" })];

describe("skyAt", () => {
  it("groups the newest table by constellation, with use and health", () => {
    const channel = table(XSENS, { 0: "GPS", 2: "Galileo" }, [
      [1, 0, 1, 50, 8],
      [2, 2, 7, 41, 16],
      [2, 0, 12, 45, 8 + 16],
      [2, 0, 3, 20, 32],
      [2, 0, 5, 0, 0],
    ]);
    const [found] = skyTables([channel]);
    expect(skyAt(found!, 4)).toEqual([
      {
        name: "GPS",
        satellites: [
          { id: "G03", strength: 20, use: "unhealthy" },
          { id: "G05", strength: 0, use: "not used" },
          { id: "G12", strength: 45, use: "used" },
        ],
      },
      { name: "Galileo", satellites: [{ id: "E07", strength: 41, use: "healthy" }] },
    ]);
    expect(skyAt(found!, -1)).toEqual([]);
  });
  it("reads the flags of another family, and separates two tables of one chunk", () => {
    const channel = table(INERTIAL, { 1: "GPS", 6: "GLO" }, [
      [1, 1, 4, 30, 8],
      [1, 6, 2, 31, 16],
      [1, 1, 4, 33, 8],
      [1, 6, 2, 34, 32],
    ]);
    const sky = skyAt(skyTables([channel])[0]!, 3);
    expect(sky.map(({ name, satellites }) => [name, satelliteTally(satellites), satellites[0]!.strength])).toEqual([
      ["GPS", "1 used", 33],
      ["GLONASS", "1 unhealthy", 34],
    ]);
  });
  it("uses signals if there are no satellites: the strongest of each", () => {
    const signals = table(INERTIAL, { 1: "GPS" }, [
      [1, 1, 4, 30, 16, 0],
      [1, 1, 4, 35, 8, 3],
    ]);
    expect(skyAt(skyTables([signals])[0]!, 1)).toEqual([
      { name: "GPS", satellites: [{ id: "G04", strength: 35, use: "used" }] },
    ]);
    const both = table(INERTIAL, { 1: "GPS" }, [[1, 1, 4, 30, 16]]);
    expect(skyTables([signals, both]).map(({ channel }) => channel)).toEqual([both]);
  });
});
