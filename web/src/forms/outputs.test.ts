import { describe, expect, it } from "vitest";
import { changed, type Entry, EVERY, outputRows, toggled, withFrame, withPrecision } from "./outputs";
import type { OutputChoice } from "./types";

const choice = (data_identifier: number, title: string, rates: number[] = []): OutputChoice => ({
  data_identifier,
  title,
  group: "",
  rates,
  formats: [],
  frames: [],
  size: 12,
  unit: "",
  basic: true,
  doc: "",
});
const CHOICES = [
  choice(0x1020, "Packet counter"),
  choice(0x2010, "Quaternion", [400, 100]),
  choice(0x4020, "Acceleration", [400, 100]),
];
const entry = (data_identifier: number, output_frequency: number): Entry => ({ data_identifier, output_frequency });
const BEFORE = [entry(0x1020, EVERY), entry(0x2010, 100)];

describe("outputRows", () => {
  it("gives current and previous outputs", () => {
    const rows = outputRows(CHOICES, [entry(0x1020, EVERY), entry(0x2014, 400), entry(0x4020, 100)], BEFORE);
    expect(rows.map(({ title, place, was }) => [title, place, was])).toEqual([
      ["Packet counter", 0, ""],
      ["Quaternion", 1, "was 100 Hz, ENU"],
      ["Acceleration", 2, "was off"],
    ]);
  });
  it("keeps unknown and duplicate entries", () => {
    const rows = outputRows(CHOICES, [entry(0x2010, 100), entry(0x2013, 100), entry(0xabc0, 1)], undefined);
    expect(rows).toHaveLength(5);
    expect(rows.slice(3).map(({ place }) => place)).toEqual([1, 2]);
  });
  it("switches off and on again without a change", () => {
    const off = toggled(CHOICES, BEFORE, outputRows(CHOICES, BEFORE, BEFORE)[1]!);
    expect(off).toEqual([entry(0x1020, EVERY)]);
    const row = outputRows(CHOICES, off, BEFORE)[1]!;
    expect(row.was).toBe("was 100 Hz");
    expect(toggled(CHOICES, off, row)).toEqual(BEFORE);
  });
  it("inserts an enabled output in table order", () => {
    const entries = [entry(0x1020, EVERY), entry(0x4020, 100)];
    expect(toggled(CHOICES, entries, outputRows(CHOICES, entries, [])[1]!).map((one) => one.data_identifier)).toEqual([
      0x1020, 0x2010, 0x4020,
    ]);
  });
  it("changes one row alone", () => {
    const row = outputRows(CHOICES, BEFORE, BEFORE)[1]!;
    expect(changed(CHOICES, BEFORE, row, { output_frequency: 400 })).toEqual([
      entry(0x1020, EVERY),
      entry(0x2010, 400),
    ]);
  });
  it("composes format bits", () => {
    expect(withFrame(withPrecision(0x2010, 3), 8)).toBe(0x201b);
    expect(withPrecision(0x201b, 0)).toBe(0x2018);
  });
});
