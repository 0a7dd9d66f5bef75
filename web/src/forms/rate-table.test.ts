import { describe, expect, it } from "vitest";
import { OUTPUTS, STREAMS, tableRow } from "../testing/fixtures";
import {
  changed,
  type Entry,
  idWords,
  offeredRates,
  rateWords,
  tableRows,
  toggled,
  withVariantBits,
} from "./rate-table";
import type { RateTable } from "../wire/form-types";

const EVERY = OUTPUTS.every;
const TABLE: RateTable = {
  ...OUTPUTS,
  rows: [
    tableRow(0x1020, "Packet counter"),
    tableRow(0x2010, "Quaternion", { rates: [400, 100] }),
    tableRow(0x4020, "Acceleration", { rates: [400, 100] }),
  ],
};
const entry = (data_identifier: number, output_frequency: number): Entry => ({ data_identifier, output_frequency });
const BLANK = entry(0, 0);
const BEFORE = [entry(0x1020, EVERY), entry(0x2010, 100)];

describe("a table of rates in Hz", () => {
  it("gives current and previous outputs", () => {
    const rows = tableRows(TABLE, [entry(0x1020, EVERY), entry(0x2014, 400), entry(0x4020, 100)], BEFORE);
    expect(rows.map(({ title, place, was }) => [title, place, was])).toEqual([
      ["Packet counter", 0, ""],
      ["Quaternion", 1, "was 100 Hz, ENU"],
      ["Acceleration", 2, "was off"],
    ]);
  });
  it("keeps unknown and duplicate entries", () => {
    const rows = tableRows(TABLE, [entry(0x2010, 100), entry(0x2013, 100), entry(0xabc0, 1)], undefined);
    expect(rows).toHaveLength(5);
    expect(rows.slice(3).map(({ place }) => place)).toEqual([1, 2]);
  });
  it("switches off and on again without a change", () => {
    const off = toggled(TABLE, BEFORE, tableRows(TABLE, BEFORE, BEFORE)[1]!, BLANK);
    expect(off).toEqual([entry(0x1020, EVERY)]);
    const row = tableRows(TABLE, off, BEFORE)[1]!;
    expect(row.was).toBe("was 100 Hz");
    expect(toggled(TABLE, off, row, BLANK)).toEqual(BEFORE);
  });
  it("inserts an enabled output in table order", () => {
    const entries = [entry(0x1020, EVERY), entry(0x4020, 100)];
    const on = toggled(TABLE, entries, tableRows(TABLE, entries, [])[1]!, BLANK);
    expect(on.map((one) => one["data_identifier"])).toEqual([0x1020, 0x2010, 0x4020]);
  });
  it("changes one row alone, and enables an output that is given a rate", () => {
    const rows = tableRows(TABLE, BEFORE, BEFORE);
    expect(changed(TABLE, BEFORE, rows[1]!, { rate: 400 }, BLANK)).toEqual([entry(0x1020, EVERY), entry(0x2010, 400)]);
    expect(changed(TABLE, BEFORE, rows[2]!, { rate: 100 }, BLANK)).toEqual([...BEFORE, entry(0x4020, 100)]);
  });
  it("composes variants, and formats keys", () => {
    const [precision, frame] = TABLE.variants;
    expect(withVariantBits(frame!, withVariantBits(precision!, 0x2010, 3), 8)).toBe(0x201b);
    expect(withVariantBits(precision!, 0x201b, 0)).toBe(0x2018);
    expect([idWords(TABLE, 0x20), idWords(STREAMS, 0x20)]).toEqual(["0x0020", "32"]);
  });
  it("offers the present rate, those of the quantity, and every sample", () => {
    const rows = tableRows(TABLE, [entry(0x2010, 7)], undefined);
    expect(rows.map((row) => offeredRates(TABLE, row))).toEqual([[], [7, 400, 100, EVERY], [400, 100, EVERY]]);
    expect(rateWords(TABLE, rows[1]!, EVERY)).not.toBe(rateWords(TABLE, rows[0]!, EVERY));
  });
});

describe("a table of divisors", () => {
  const set = (did: number, interval_ms: number) => tableRow(did, `Set ${did}`, { interval_ms });
  const table: RateTable = { ...STREAMS, rows: [set(4, 7), set(13, 200), set(119, 0)] };
  const blank = { did: 0, period: 0, size: 0 };

  it("reads divisors as rates", () => {
    const rows = tableRows(table, [], undefined);
    expect(rows.map((row) => rateWords(table, row, 1))).toEqual(["143 Hz", "5 Hz", "native rate"]);
    expect(rateWords(table, rows[0]!, 10)).toBe("14.3 Hz");
    expect(offeredRates(table, { ...rows[0]!, rate: 7 })).toEqual([1, 2, 5, 7, 10]);
  });
  it("switches streams on and off, and gives the previous ones", () => {
    const before = [{ did: 4, period: 1, size: 0 }];
    const slower = changed(table, before, tableRows(table, before, before)[0]!, { rate: 5 }, blank);
    const rows = tableRows(table, slower, before);
    expect(rows[0]?.was).toBe("was 143 Hz");
    const more = toggled(table, slower, rows[1]!, blank);
    expect(more).toEqual([
      { did: 4, period: 5, size: 0 },
      { did: 13, period: 1, size: 0, source_ms: 200 },
    ]);
    expect(toggled(table, more, tableRows(table, more, before)[0]!, blank)).toEqual([more[1]]);
  });
  it("keeps a stream that the table does not know", () => {
    expect(tableRows(table, [{ did: 500, period: 2 }], []).at(-1)).toMatchObject({
      title: "Not in the table",
      place: 0,
      was: "was off",
    });
  });
  it("names no two of the offered rates alike", () => {
    const slow = tableRows({ ...table, divisors: [1, 200, 500, 1000] }, [], undefined)[1]!;
    const words = offeredRates({ ...table, divisors: [1, 200, 500, 1000] }, slow).map((rate) =>
      rateWords(table, slow, rate),
    );
    expect(words).toEqual(["5 Hz", "0.025 Hz", "0.01 Hz", "0.005 Hz"]); // "0.01 Hz" stood there twice
  });
  it("shows the measured rate in preference to the table's", () => {
    const entries = [{ did: 4, period: 2, source_ms: 16 }];
    const rows = tableRows(table, entries, entries);
    expect(rows.map((row) => rateWords(table, row, row.rate))).toEqual(["31.3 Hz", "5 Hz", "native rate"]);
    expect(tableRows(table, [{ did: 4, period: 4, source_ms: 16 }], entries)[0]?.was).toBe("was 31.3 Hz");
  });
});
