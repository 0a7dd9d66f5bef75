import { describe, expect, it } from "vitest";
import { field, setting } from "../testing/fixtures";
import {
  at,
  big,
  bitsOf,
  initial,
  isReserved,
  offered,
  put,
  ownRangeWords,
  rangeWords,
  read,
  same,
  small,
  textProblem,
  typed,
  whereOf,
  withBits,
  valueWords,
} from "./values";

const angle = field({ name: "roll", editor: "number", unit: "°", scale: 180 / Math.PI, low: -Math.PI, high: Math.PI });
const rate = field({ name: "rate", editor: "integer", unit: "Hz", low: 1, high: 2000, step: 1 });

describe("wire and shown", () => {
  it("converts units both ways", () => {
    expect(typed(angle, Math.PI / 4)).toBe("45");
    expect(read(angle, "45")).toEqual({ value: (45 / 180) * Math.PI });
    expect(typed(rate, 400)).toBe("400");
  });
  it("shows a float32 with the digits that it has, and a double with all", () => {
    expect(typed(field({ editor: "number" }), Math.fround(0.1))).toBe("0.1");
    expect(typed(field({ editor: "number" }), 52.22031812345)).toBe("52.22031812345");
  });
  it("keeps every bit of a 64-bit word", () => {
    const word = small(0x8808601001300c00n);
    expect(typeof word).toBe("string");
    expect(big(word)).toBe(0x8808601001300c00n);
    expect(bitsOf(withBits(big(word), { low: 62, width: 1 }, 1n), { low: 62, width: 1 })).toBe(1n);
    expect(read(field({ editor: "integer", step: 1 }), "18446744073709551615")).toEqual({
      value: "18446744073709551615",
    });
  });
});

describe("typed input", () => {
  it("is refused with the reason", () => {
    expect(read(rate, "0")).toEqual({ problem: "1 to 2\u2009000 Hz." });
    expect(read(rate, "2.5")).toEqual({ problem: "Enter a whole number." });
    expect(read(rate, "fast")).toEqual({ problem: "Not a number. Enter digits, with a point for decimals." });
    expect(read(rate, " ")).toEqual({ problem: "Enter a number." });
    expect(read(angle, "200")).toEqual({ problem: "−180 to 180 °." });
  });
  it("may be hex or have a decimal comma", () => {
    expect(read(rate, "0x10")).toEqual({ value: 16 });
    expect(read(field({ editor: "number" }), "1,5")).toEqual({ value: 1.5 });
  });
  it("reaches the exact limit of a range in another unit", () => {
    expect(read(angle, "180")).toEqual({ value: Math.PI });
  });
  it("is checked for length if it is text or hex", () => {
    expect(textProblem(field({ editor: "hex", max_length: 2 }), "AA BB CC")).toBe("At most 2 bytes.");
    expect(textProblem(field({ editor: "hex" }), "ABC")).toBe("Enter two hex digits per byte.");
    expect(textProblem(field({ editor: "text", length: 3 }), "abcd")).toBe("At most 3 characters.");
    expect(textProblem(field({ editor: "text" }), "abcd")).toBeUndefined();
  });
});

describe("paths", () => {
  it("go into lists and into names with dots", () => {
    const values = { "imu.time": 1, outputs: [{ rate: 1 }, { rate: 2 }] };
    expect(at(values, ["imu.time"])).toBe(1);
    expect(put(values, ["outputs", 1, "rate"], 5)).toEqual({ "imu.time": 1, outputs: [{ rate: 1 }, { rate: 5 }] });
    expect(at(values, ["no", 3, "where"])).toBeUndefined();
  });
  it("compare by meaning", () => {
    expect(same({ a: [1, "2"] }, { a: [1, 2] })).toBe(true);
    expect(same([1], [1, 2])).toBe(false);
    expect(same({ f32: "7fc00000" }, { f32: "7fc00000" })).toBe(true);
  });
});

describe("texts", () => {
  it("name choices, bits and units", () => {
    expect(valueWords(rate, 400)).toBe("400 Hz");
    expect(valueWords(field({ editor: "choice", choices: { "2": "115 200 Bd" } }), 2)).toBe("115 200 Bd");
    const flags = field({ editor: "flags", bits: [bit("A", 0), bit("B", 4)] });
    expect(valueWords(flags, 16)).toBe("B");
    expect(valueWords(flags, 0)).toBe("none");
    expect(valueWords(rate, undefined)).toBe("—");
    expect(rangeWords(field({ low: 0, high: null }))).toBe("at least 0");
  });
  it("name a range of the setting, and none that is only its type's", () => {
    const word = field({ step: 1, low: 0, high: 4_294_967_295, unit: "ms" });
    expect(ownRangeWords(word)).toBe("");
    expect(ownRangeWords({ ...word, low: 200, limited: ["low"] })).toBe("at least 200 ms");
    expect(ownRangeWords({ ...word, high: 500, limited: ["high"] })).toBe("0 to 500 ms");
    expect(read(word, "5e9")).toMatchObject({ problem: expect.stringContaining("whole") });
    expect(read(word, "5000000000")).toEqual({ problem: `${rangeWords(word)}.` });
  });
  it("show an identifier as its label does", () => {
    const id = field({ base: 16, step: 1, read_only: true });
    expect([typed(id, 0x0080003a), valueWords(id, 0x0080003a), valueWords(id, "36047404379471887")]).toEqual([
      "0080003A",
      "0080003A",
      "8010EC5D1D000F",
    ]);
    expect([typed(id, 0x80800001), typed(id, "9259400838168707072")]).toEqual(["0080800001", "0080800001"]);
    expect(read(id, "0080003A")).toEqual({ value: 0x0080003a });
  });
  it("start with the table's default, else with an allowed value", () => {
    expect(initial(rate)).toBe(1);
    expect(initial(field({ editor: "vector", length: 3 }))).toEqual([0, 0, 0]);
    expect(initial(field({ editor: "choice", choices: { "3": "x" } }))).toBe(3);
    expect(initial(field({ editor: "hex", length: 2 }))).toBe("0000");
  });
});

function bit(name: string, low: number) {
  return { name, low, width: 1, choices: {}, severity: "" as const, normal_set: false, doc: "" };
}

it("offers no flag that is reserved, unused or deprecated", () => {
  const named = (name: string): boolean => isReserved({ name, doc: "" });
  expect(["RESERVED_3", "UNUSED1", "FLAGS_UNUSED_1", "UBLOX_SER0_DEPRECATED"].every(named)).toBe(true);
  expect(["UNUSED_INPUT", "ENABLE_MAG_CONTINUOUS_CAL"].some(named)).toBe(false);
});

describe("offered choices", () => {
  const rates = { "10": "921 600 Bd", "128": "921 600 Bd", "2": "115 200 Bd", "255": "invalid", "7": "Reserved" };
  it("have each meaning once and no invalid one", () => {
    expect(Object.values(offered(rates, 2)).sort()).toEqual(["115 200 Bd", "921 600 Bd"]);
  });
  it("include the device's value", () => {
    expect(offered(rates, 128)).toEqual({ "128": "921 600 Bd", "2": "115 200 Bd" });
    expect(offered(rates, 255)["255"]).toBe("invalid");
  });
});

it("describes the position of a value in readable form", () => {
  const ports = setting({
    name: "PortConfig",
    title: "Ports",
    fields: [field({ name: "words", title: "Ports", editor: "list" })],
  });
  expect(whereOf(ports, "words.1")).toBe("Ports 2");
  const place = setting({ title: "Position", fields: [field({ name: "lat", title: "Latitude" })] });
  expect(whereOf(place, "lat")).toBe("Position, Latitude");
  expect(whereOf(place, "nothing")).toBe("Position");
});
