import { expect, it } from "vitest";
import { field, OUTPUT_SETTING as outputs, outputsOf as out, setting } from "../testing/fixtures";
import { rebase } from "./rebase";

const flash = setting({
  name: "Flash",
  partial: true,
  fields: [field({ name: "a" }), field({ name: "b" }), field({ name: "v", editor: "vector", length: 3 })],
});

it("keeps one edit when another user writes the same setting", () => {
  const base = out([0x2010, 100], [0x4020, 100], [0x8020, 100]);
  const { draft, elsewhere } = rebase(
    outputs,
    base,
    out([0x2010, 400], [0x4020, 100], [0x8020, 100]),
    out([0x2010, 100], [0x4020, 50], [0xc020, 50]),
  );
  expect(draft).toEqual(out([0x2010, 400], [0x4020, 50], [0xc020, 50]));
  expect(elsewhere.map(({ conflict }) => conflict)).toEqual([false, false, false]);
});

it("reports where both changed the same value, and keeps the local edit", () => {
  const { draft, elsewhere } = rebase(
    flash,
    { a: 1, b: 2, v: [0, 0, 0] },
    { a: 5, b: 2, v: [0, 1, 0] },
    { a: 9, b: 7, v: [3, 0, 0] },
  );
  expect(draft).toEqual({ a: 5, b: 7, v: [3, 1, 0] });
  expect(elsewhere.map(({ path, conflict }) => [path.join("."), conflict])).toEqual([
    ["a", true],
    ["b", false],
    ["v.0", false],
  ]);
});

it("has no conflict if both made the same change", () => {
  const { draft, elsewhere } = rebase(flash, { a: 1 }, { a: 2 }, { a: 2 });
  expect(draft).toEqual({ a: 2 });
  expect(elsewhere.some(({ conflict }) => conflict)).toBe(false);
});

it("keeps outputs switched off and on locally", () => {
  const base = out([0x2010, 100], [0x4020, 100]);
  const { draft } = rebase(outputs, base, out([0x4020, 100], [0x8020, 10]), out([0x2010, 100], [0x4020, 20]));
  expect(draft).toEqual(out([0x4020, 20], [0x8020, 10]));
});
