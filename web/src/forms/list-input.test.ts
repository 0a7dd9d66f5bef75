import { expect, it } from "vitest";
import { field } from "../testing/fixtures";
import type { FormContext } from "./form-context";
import { hasMeanings, meantFields, signedContext } from "./list-input";
import type { Meaning } from "../wire/form-types";
import { at, read, typed } from "./values";

const meaning = (given: Partial<Meaning> & Pick<Meaning, "values" | "title">): Meaning => ({
  unit: "ms",
  scale: 0.1,
  decimals: 1,
  signed: false,
  low: null,
  high: null,
  doc: "",
  ...given,
});
const fields = [
  field({ name: "function" }),
  field({
    name: "word",
    step: 1,
    low: 0,
    high: 65535,
    meaning_of: "function",
    meanings: [
      meaning({ values: [9], title: "Clock period", scale: 1 }),
      meaning({ values: [4, 14], title: "Offset", signed: true, low: -30_000, high: 30_000 }),
      meaning({ values: [], title: "Delay", low: 0, high: 60_000 }),
    ],
  }),
];
const wordAs = (what: number) => meantFields(fields, { function: what })[1]!;

it("shows a negative offset as one, and writes it back", () => {
  let written: unknown;
  const form: FormContext = {
    id: "s",
    values: { settings: [{ function: 14, word: 65_526 }] },
    before: { settings: [{ function: 8, word: 65_526 }] },
    problems: [],
    readOnly: false,
    all: true,
    options: {},
    sought: "",
    axes: "FLU",
    ports: [],
    epoch: 0,
    set: (_, value) => (written = value),
    wrong: () => undefined,
    hover: () => undefined,
  };
  const signed = signedContext(form, ["settings", 0], fields);
  expect(typed(wordAs(14), at(signed.values, ["settings", 0, "word"]))).toBe("-1.0");
  expect(at(signed.before, ["settings", 0, "word"])).toBe(65_526);
  const reading = read(wordAs(14), "-2.5");
  expect(reading).toEqual({ value: -25 });
  signed.set(["settings", 0, "word"], -25);
  expect(written).toBe(65_511);
  signed.set(["settings", 0, "function"], -1);
  expect(written).toBe(-1);
});

it("has the unit and the range of its meaning", () => {
  expect([8, 14, 9].map(wordAs).map(({ title, scale, low, high }) => [title, scale, low, high])).toEqual([
    ["Delay", 0.1, 0, 60_000],
    ["Offset", 0.1, -30_000, 30_000],
    ["Clock period", 1, 0, 65_535],
  ]);
  expect([hasMeanings(fields), hasMeanings(fields.slice(0, 1))]).toEqual([true, false]);
});
