import { describe, expect, it } from "vitest";
import { barOf, overWords, ratesOf } from "./budget";
import { field, forms, setting } from "../testing/fixtures";
import type { LoadInfo } from "../wire/form-types";

const load = (parts: number[], capacity: number | null = 11_520, baud: number | null = 115_200): LoadInfo => ({
  parts: parts.map((bytes_per_s, k) => ({ path: `outputs.${k}`, title: `Output ${k}`, bytes_per_s })),
  total: parts.reduce((a, b) => a + b, 0),
  capacity,
  baud,
  limits: [],
  measured: null,
});

describe("barOf", () => {
  it("draws shares side by side, to the scale of the line", () => {
    const bar = barOf(load([2880, 0, 5760]), load([2880]), undefined, []);
    expect(bar.shares.map(({ path, from, width }) => [path, from, width])).toEqual([
      ["outputs.0", 0, 0.25],
      ["outputs.2", 0.25, 0.5],
    ]);
    expect(bar.fill).toBe(0.75);
    expect(bar.over).toBeUndefined();
    expect(bar.before).toBe(0.25);
  });
  it("shows an overload", () => {
    const bar = barOf(load([23_040]), null, undefined, []);
    expect(bar.fill).toBe(2);
    expect(bar.over).toBe(0.5);
    expect(overWords(load([23_040]), undefined)).toBe("The outputs need 200.0 % of the link.");
    expect(overWords(load([11_521]), undefined)).toBe("The outputs need 100.1 % of the link.");
    expect(overWords(load([11_520]), undefined)).toBe("");
  });
  it("uses the rate that will be in effect", () => {
    const bar = barOf(load([23_040]), null, 921_600, [115_200, 230_400, 460_800, 921_600]);
    expect(bar.fill).toBe(0.25);
    expect(bar.marks.map(({ baud, at, is }) => [baud, at, is])).toEqual([
      [921_600, 1, "capacity"],
      [115_200, 0.125, "now"],
      [460_800, 0.5, "other"],
    ]);
  });
  it("has no limit if the link has none", () => {
    const bar = barOf(load([100], null, null), null, undefined, [9600]);
    expect(bar.fill).toBeUndefined();
    expect(bar.marks).toEqual([]);
    expect(overWords(load([1e9], null, null), undefined)).toBe("");
  });
});

it("finds the rates of a product in its settings", () => {
  const bits = {
    name: "Baud",
    low: 0,
    width: 8,
    choices: { "2": "115 200 Bd", "10": "921 600 Bd", "255": "invalid" },
    severity: "" as const,
    normal_set: false,
    doc: "",
  };
  const all = forms({
    settings: [
      setting({
        fields: [
          field({ name: "words", bits: [bits] }),
          field({ name: "ser0BaudRate", choices: { "9600": "9 600 Bd" } }),
        ],
      }),
    ],
  });
  expect(ratesOf(all)).toEqual([9600, 115_200, 921_600]);
});
