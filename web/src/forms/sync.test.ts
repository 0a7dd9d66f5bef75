import { expect, it } from "vitest";
import { field } from "./fixtures";
import type { Sheet } from "./form-context";
import { signedSheet, syncFields } from "./sync";
import { at, read, typed } from "./values";

const WORD = "delay_offset_or_clock_period";
const fields = [field({ name: "function" }), field({ name: WORD, step: 1, low: 0, high: 65535 })];
const wordAs = (what: number) => syncFields(fields, { function: what })[1]!;

it("shows a negative offset as one, and writes it back", () => {
  let written: unknown;
  const sheet: Sheet = {
    id: "s", values: { settings: [{ function: 14, [WORD]: 65_526 }] }, before: undefined, problems: [], readOnly: false, all: true, options: {}, sought: "", epoch: 0,
    set: (_, value) => (written = value), wrong: () => undefined, hover: () => undefined,
  };
  const signed = signedSheet(sheet, ["settings", 0]);
  expect(typed(wordAs(14), at(signed.values, ["settings", 0, WORD]))).toBe("-1.0");
  const reading = read(wordAs(14), "-2.5");
  expect(reading).toEqual({ value: -25 });
  signed.set(["settings", 0, WORD], -25);
  expect(written).toBe(65_511);
});

it("has the unit of its function", () => {
  expect([wordAs(8), wordAs(14), wordAs(9)].map(({ title, unit, scale }) => [title, unit, scale])).toEqual([
    ["Delay", "ms", 0.1],
    ["Offset", "ms", 0.1],
    ["Clock period", "ms", 1],
  ]);
});
