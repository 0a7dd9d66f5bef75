import { describe, expect, it } from "vitest";
import { beside, column, EDGES, leaves, type Split, type Wish } from "../data/tiles";
import { oneOf, seeded } from "../testing/random-workspace";
import { arrangement } from "./rectangles";

const WISHES: Record<string, Wish> = {
  attitude: { height: 212, least: 104 },
  plots: { height: 700, least: 240, grows: true },
};
const wishes = (id: string): Wish => WISHES[id] ?? { height: 260, least: 120 };
const heights = (tree: Split, height: number) => {
  const { boxes } = arrangement(tree, 1000, height, wishes);
  return leaves(tree).map((id) => boxes.get(id)?.height);
};

describe("panels below each other", () => {
  const tree = column(["attitude", "plots"]);
  it("have the height that they ask for, and the plots take the rest", () =>
    expect(heights(tree, 1200)).toEqual([212, 987]));
  it("leave the plots their room first", () => expect(heights(tree, 852)).toEqual([151, 700]));
  it("are no lower than they can be read, then the plots scroll", () => expect(heights(tree, 500)).toEqual([104, 395]));
  it("make the middle scroll if not even that fits", () => {
    expect(arrangement(tree, 1000, 300, wishes).height).toBe(345);
    expect(heights(tree, 300)).toEqual([104, 240]);
  });
});

it("a random tree fills the room without a gap or an overlap", () => {
  const next = seeded(3);
  let tree = column(["attitude", "plots"]);
  for (const id of ["a", "b", "c", "d", "e"]) {
    tree = beside(tree, id, oneOf(next, leaves(tree)), oneOf(next, EDGES));
    if (next() < 0.5) tree = { ...tree, shares: tree.parts.map(() => 1 + 5 * next()) };
    const { boxes, seams, height } = arrangement(tree, 1200, 900, wishes);
    const areas = [...boxes.values(), ...seams.map(({ box }) => box)].map((box) => box.width * box.height);
    expect(areas.reduce((sum, one) => sum + one, 0)).toBe(1200 * Math.max(900, Math.round(height)));
    for (const box of boxes.values())
      expect(Math.min(box.left, box.top, box.width - 60, box.height - 60)).toBeGreaterThanOrEqual(0);
    for (const { limits, sizes, after } of seams)
      expect(limits[0] <= sizes[after]! + 1 && sizes[after]! <= limits[1] + 1).toBe(true);
  }
});
