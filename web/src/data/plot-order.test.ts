/** The order and the heights of plots. */
import { expect, it } from "vitest";
import { heightOf, inOrder, movedTo, withHeight } from "./plot-order";

const plots = (...keys: readonly string[]) => keys.map((key) => ({ key }));
const keysOf = (list: readonly { readonly key: string }[]): string => list.map(({ key }) => key).join(" ");

it("is the default until somebody moves a plot", () => {
  expect(keysOf(inOrder(plots("a", "b", "c"), {}))).toBe("a b c");
  const moved = movedTo({}, ["a", "b", "c"], "c", 0);
  expect(keysOf(inOrder(plots("a", "b", "c"), moved))).toBe("c a b");
  expect(movedTo({}, ["a", "b"], "a", 0)).toEqual({});
});

it("gives a plot that is new its place behind the one that it follows", () => {
  const { order } = movedTo({}, ["a", "b", "c"], "c", 0);
  expect(keysOf(inOrder(plots("new", "a", "x", "b", "c", "y"), { order: order ?? [] }))).toBe("new c y a x b");
});

it("keeps the places of plots that are away", () => {
  const of = { order: ["c", "a", "b"] };
  const moved = movedTo(of, ["c", "b"], "b", 0);
  expect(keysOf(inOrder(plots("b", "c"), moved))).toBe("b c");
  expect(moved.order).toContain("a");
});

it("a place beyond the ends is the end", () => {
  expect(movedTo({}, ["a", "b"], "a", 9).order).toEqual(["b", "a"]);
  expect(movedTo({ order: ["b", "a"] }, ["b", "a"], "a", -3).order).toEqual(["a", "b"]);
});

it("heights are kept within their limits, and given back", () => {
  const high = withHeight({ order: ["a"] }, "a", 5000.4);
  expect(heightOf(high, "a")).toBe(1200);
  expect(heightOf(withHeight(high, "b", 1), "b")).toBe(40);
  expect(withHeight(high, "a", undefined)).toEqual({ order: ["a"] });
});
