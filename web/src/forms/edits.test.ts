import { describe, expect, it } from "vitest";
import { changes, changesOf, countOf, sameSetting, toApply, touches, wasAt } from "./edits";
import { field, forms, OUTPUT_SETTING as outputs, outputsOf as out, setting, STREAMS } from "../testing/fixtures";

const flash = setting({
  name: "Flash",
  partial: true,
  fields: [field({ name: "a" }), field({ name: "b" }), field({ name: "told", read_only: true })],
});

describe("changes", () => {
  it("are found in records, lists and vectors", () => {
    const nested = [
      field({ name: "r", editor: "record", fields: [field({ name: "x" }), field({ name: "y" })] }),
      field({ name: "v", editor: "vector", length: 2 }),
    ];
    const found = changes(nested, { r: { x: 1, y: 2 }, v: [1, 2] }, { r: { x: 1, y: 3 }, v: [1, 5] });
    expect(found.map(({ path }) => path.join("."))).toEqual(["r.y", "v.1"]);
  });
  it("count rows of the output configuration, whatever their order", () => {
    const before = out([0x2010, 100], [0x4020, 100], [0x8020, 100]);
    expect(countOf(outputs, before, out([0x8020, 100], [0x2010, 400], [0x4021, 100], [0xc020, 50]))).toBe(3);
    expect(countOf(outputs, before, out([0x2010, 100]))).toBe(2);
    expect(countOf(outputs, before, before)).toBe(0);
  });
  it("mark only the entry that was edited, also when their number changes", () => {
    const before = out([0x2010, 100], [0x4020, 100]);
    const more = changesOf(outputs, before, out([0x2010, 100], [0x8020, 10], [0x4020, 100]));
    expect([0, 1, 2].map((place) => touches(more, ["outputs", place]))).toEqual([false, true, false]);
    const fewer = changesOf(outputs, before, out([0x4020, 100]));
    expect(fewer).toHaveLength(1);
    expect(touches(fewer, ["outputs", 0])).toBe(false);
    const ports = setting({ name: "PortConfig", fields: [field({ name: "words", editor: "list", length: 3 })] });
    const one = changesOf(ports, { words: [2, 2, 0] }, { words: [10, 2, 0] });
    expect([0, 1, 2].map((place) => touches(one, ["words", place]))).toEqual([true, false, false]);
    expect(countOf(ports, { words: [2, 2, 0] }, { words: [10, 2, 0] })).toBe(1);
  });
  it("ignore the order of a set and read-only values", () => {
    const streams = setting({
      name: "Streams",
      table: STREAMS,
      fields: [field({ name: "streams", editor: "list", fields: [field({ name: "did" }), field({ name: "period" })] })],
    });
    const of = (...dids: number[]) => ({ streams: dids.map((did) => ({ did, period: 1 })) });
    expect(sameSetting(streams, of(3, 5), of(5, 3))).toBe(true);
    expect(countOf(streams, of(3, 5), of(5, 3))).toBe(0);
    expect(sameSetting(flash, { a: 1, b: 2, told: 5 }, { a: 1, b: 2, told: 6 })).toBe(true);
    expect(sameSetting(flash, undefined, { a: 1 })).toBe(false);
  });
  it("include the paths within and around them", () => {
    const found = changes(outputs.fields, out([1, 1], [2, 2]), out([1, 1], [2, 3]));
    expect(touches(found, ["outputs", 1])).toBe(true);
    expect(touches(found, ["outputs", 0])).toBe(false);
    expect(touches(found, ["outputs", 1, "output_frequency"])).toBe(true);
  });
});

describe("sent changes", () => {
  const all = forms({
    settings: [outputs, flash, setting({ name: "Told", writable: false, fields: [field({ name: "x" })] })],
  });
  it("are empty without differences", () => {
    expect(toApply(all, { Flash: { a: 1, b: 2 } }, { Flash: { a: 1, b: 2 } })).toEqual({});
  });
  it("are single fields if the setting allows it, without read-only values", () => {
    const sent = toApply(all, { Flash: { a: 1, b: 2, told: 5 } }, { Flash: { a: 1, b: 3, told: 6 }, Told: { x: 1 } });
    expect(sent).toEqual({ Flash: { b: 3 } });
  });
  it("are a whole setting otherwise", () => {
    expect(
      toApply(all, { OutputConfiguration: out([1, 1], [2, 2]) }, { OutputConfiguration: out([1, 1], [2, 4]) }),
    ).toEqual({
      OutputConfiguration: out([1, 1], [2, 4]),
    });
  });
});

it("gives the previous value, and nothing if it was never read", () => {
  expect(wasAt({ a: 1 }, { a: 2 }, ["a"])).toBe(1);
  expect(wasAt({ a: 1 }, { a: 1 }, ["a"])).toBeUndefined();
  expect(wasAt(undefined, { a: 1 }, ["a"])).toBeUndefined();
});
