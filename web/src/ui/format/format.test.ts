import { describe, expect, it } from "vitest";
import { age, byteRate, clock, decimalsOf, geographic, NONE, number, rate, signed, span } from "./format";
import { count } from "../../texts/plural";

describe("number", () => {
  it("has fixed decimals, a true minus and thin spaces", () => {
    expect(number(-5.84, 3)).toBe("−5.840");
    expect(number(101284, 0)).toBe("101\u2009284");
    expect(number(1234.5, 2)).toBe("1\u2009234.50");
    expect(number(999, 0)).toBe("999");
    expect(number(1e15, 0)).toBe("1.000e15");
  });
  it("never writes a negative zero", () => {
    expect(number(-0, 2)).toBe("0.00");
    expect(number(-0.004, 2)).toBe("0.00");
    expect(signed(-0.004, 2)).toBe("0.00");
  });
  it("writes a dash for what is not a number", () => {
    for (const value of [undefined, Number.NaN, Number.POSITIVE_INFINITY]) expect(number(value, 2)).toBe(NONE);
  });
  it("keeps its width while a value changes sign at the same size", () => {
    expect(number(9.995, 2).length).toBe(number(-9.995, 2).length - 1);
    expect(signed(12.4, 1)).toBe("+12.4");
    expect(signed(-12.4, 1)).toBe("−12.4");
  });
});

describe("other formats", () => {
  it("groups both sides of a geographic angle", () => {
    expect(geographic(52.2203184)).toBe("52.220\u2009318\u20094");
    expect(geographic(undefined)).toBe(NONE);
  });
  it("chooses the unit of an age", () => {
    expect(age(0.004)).toEqual({ value: "4", unit: "ms" });
    expect(age(0.9999)).toEqual({ value: "1.0", unit: "s" });
    expect(age(2.53)).toEqual({ value: "2.5", unit: "s" });
    expect(age(95)).toEqual({ value: "95", unit: "s" });
    expect(age(180)).toEqual({ value: "3", unit: "min" });
    expect(age(-1)).toEqual({ value: "0", unit: "ms" });
  });
  it("writes spans and rates", () => {
    expect(span(0.5)).toEqual({ value: "500", unit: "ms" });
    expect(span(20)).toEqual({ value: "20", unit: "s" });
    expect(span(17.25)).toEqual({ value: "17.3", unit: "s" });
    expect(span(300)).toEqual({ value: "5", unit: "min" });
    expect(byteRate(33900)).toEqual({ value: "33.9", unit: "kB/s" });
    expect(rate(399.7)).toBe("400");
    expect(rate(4)).toBe("4.0");
  });
  it("writes the time of day in UTC without rounding up into the next second", () => {
    expect(clock(52338.2149, 3)).toBe("14:32:18.214");
    expect(clock(59.9996, 3)).toBe("00:00:59.999");
    expect(clock(1_700_000_000)).toBe("22:13:20");
  });
  it("counts", () => {
    expect(count(1, "gap")).toBe("1 gap");
    expect(count(1204, "sample")).toBe("1\u2009204 samples");
  });
});

describe("decimalsOf", () => {
  it("takes the table's decimals, then the unit's, then three; whole numbers have none", () => {
    expect(decimalsOf({ decimals: 5, dtype: "f4", unit: "°" })).toBe(5);
    expect(decimalsOf({ decimals: -1, dtype: "f4", unit: "m/s²" })).toBe(3);
    expect(decimalsOf({ decimals: -1, dtype: "f4", unit: "furlong" })).toBe(3);
    expect(decimalsOf({ decimals: -1, dtype: "u4", unit: "ms" })).toBe(0);
  });
});
