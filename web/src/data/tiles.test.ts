import { expect, it } from "vitest";
import { beside, column, exchanged, leaves, pruned, type Split, tilesOf, withShares } from "./tiles";

const row = (...parts: Split["parts"]): Split => ({ along: "row", parts });

it("a panel goes to an edge of another one", () => {
  const tree = column(["attitude", "plots"]);
  expect(beside(tree, "xy", "plots", "right")).toEqual(column(["attitude", row("plots", "xy")]));
  expect(beside(tree, "xy", "plots", "top")).toEqual(column(["attitude", "xy", "plots"]));
  expect(beside(tree, "attitude", "plots", "left")).toEqual(row("attitude", "plots"));
  expect(beside(tree, "plots", "plots", "left")).toBe(tree);
  expect(beside(tree, "attitude", undefined, "right")).toEqual(row("plots", "attitude"));
  expect(beside(tree, "xy", undefined, "bottom")).toEqual(column(["attitude", "plots", "xy"]));
  expect(beside(tree, "xy", "gone", "left")).toBe(tree);
});

it("a split of its parent's direction becomes a part of it, with its share", () => {
  const tree = { ...column([row("a", "b"), "c"]), shares: [3, 1] };
  expect(beside(tree, "d", "c", "bottom")).toEqual({ ...column([row("a", "b"), "c", "d"]), shares: [3, 0.5, 0.5] });
});

it("what is not shown has no room, and what came later stands at the end", () => {
  const tree = column([row("a", "b"), "c"]);
  expect(pruned(tree, ["b", "c", "new"])).toEqual(column(["b", "c", "new"]));
  expect(pruned(row("a", "b"), ["a", "b", "new"])).toEqual(column([row("a", "b"), "new"]));
  expect(pruned(undefined, ["a"])).toEqual(column(["a"]));
  expect(pruned({ ...column(["a", "b"]), shares: [1, 3] }, ["b", "new"])).toEqual(column(["b", "new"]));
});

it("however deep panels were put into one another, the tree is read again", () => {
  let tree = column(["p0"]);
  for (let k = 1; k < 30; k += 1) tree = beside(tree, `p${k}`, `p${k - 1}`, k % 2 ? "right" : "bottom");
  expect(tilesOf(JSON.parse(JSON.stringify(tree)))).toEqual(tree);
});

it("two panels change places, and a split its shares", () => {
  const tree = column([row("a", "b"), "c"]);
  expect(leaves(exchanged(tree, "a", "c"))).toEqual(["c", "b", "a"]);
  const sized = withShares(tree, [0], [1, 2]);
  expect(sized).toEqual(column([{ ...row("a", "b"), shares: [1, 2] }, "c"]));
  expect(withShares(sized, [0], undefined)).toEqual(tree);
});
