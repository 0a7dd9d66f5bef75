/**
 * Where the tiles of the middle are, px: from the tree, the room there is and what each panel asks for. Pure, so that panels stay where
 * they are in the document when they are moved: nothing is mounted anew.
 *
 * dockview, lumino and golden-layout do this in 85, 51 and 30 kB compressed; these rules are 1 kB, and keep the plots' room.
 */
import type { Split, Tile, Wish } from "../data/tiles";

export interface Box {
  readonly left: number;
  readonly top: number;
  readonly width: number;
  readonly height: number;
}

/** The line between two parts of a split. */
export interface Seam {
  /** Of the split, and the part before the line. */
  readonly path: readonly number[];
  readonly after: number;
  readonly along: Split["along"];
  readonly box: Box;
  /** Sizes of the parts of the split, px. */
  readonly sizes: readonly number[];
  /** Between which of these the line may be. */
  readonly limits: readonly [least: number, greatest: number];
}

export interface Arrangement {
  readonly boxes: ReadonlyMap<string, Box>;
  readonly seams: readonly Seam[];
  /** Higher than the room if not even the least heights fit: the middle is scrolled then. */
  readonly height: number;
}

/** Width of the line between tiles, and the least width of a tile, px. */
const [LINE, LEAST_WIDTH] = [1, 160];

/** What a tile asks for: of panels below each other the sum, of panels beside each other the most. */
export function wishOf(tile: Tile, wishes: (id: string) => Wish): Wish {
  if (typeof tile === "string") return wishes(tile);
  const all = tile.parts.map((part) => wishOf(part, wishes));
  const grows = all.some((wish) => wish.grows);
  const joined = (of: (wish: Wish) => number): number =>
    tile.along === "row" ? Math.max(0, ...all.map(of)) : all.reduce((sum, wish) => sum + of(wish) + LINE, -LINE);
  return { height: joined(({ height }) => height), least: joined(({ least }) => least), grows };
}

/** `total` px among parts: those that grow take what is over; what lacks is taken from the others first. */
function byWish(all: readonly Wish[], total: number): number[] {
  const sizes = all.map(({ height }) => height);
  let over = total - sizes.reduce((sum, one) => sum + one, 0);
  const give = (of: (wish: Wish, k: number) => number): void => {
    const weights = all.map(of);
    const sum = weights.reduce((whole, one) => whole + one, 0);
    if (sum === 0 || over === 0) return;
    const change = over < 0 ? Math.max(over, -sum) : over;
    weights.forEach((weight, k) => (sizes[k] = (sizes[k] ?? 0) + (change * weight) / sum));
    over -= change;
  };
  const slack = ({ least }: Wish, k: number): number => Math.max(0, (sizes[k] ?? 0) - least);
  if (over > 0) {
    const anyGrows = all.some(({ grows }) => grows);
    give(({ grows, height }) => (grows || !anyGrows ? height : 0));
  } else {
    give((wish, k) => (wish.grows ? 0 : slack(wish, k)));
    give((wish, k) => (wish.grows ? slack(wish, k) : 0));
  }
  return sizes;
}

/** `total` px by shares, none under its least size as far as there is room. */
function byShares(shares: readonly number[], least: readonly number[], total: number): number[] {
  const held = new Set<number>();
  for (;;) {
    const room = total - [...held].reduce((sum, k) => sum + (least[k] ?? 0), 0);
    const sum = shares.reduce((whole, share, k) => whole + (held.has(k) ? 0 : share), 0);
    const sizes = shares.map((share, k) => (held.has(k) ? (least[k] ?? 0) : (room * share) / sum));
    const short = sizes.findIndex((size, k) => !held.has(k) && size < (least[k] ?? 0) - 0.5);
    if (short < 0 || held.size === shares.length - 1) return sizes;
    held.add(short);
  }
}

/** Edges on whole pixels. */
function edges(sizes: readonly number[], from: number): number[] {
  let at = from;
  return sizes.map((size) => {
    const start = Math.round(at);
    at += size + LINE;
    return start;
  });
}

export function arrangement(
  tree: Split,
  width: number,
  height: number,
  wishes: (id: string) => Wish,
  path: readonly number[] = [],
  [left, top]: readonly [number, number] = [0, 0],
): Arrangement {
  const { along, parts } = tree;
  const isRow = along === "row";
  const all = parts.map((part) => wishOf(part, wishes));
  const room = Math.max(height, wishOf(tree, wishes).least);
  const total = (isRow ? width : room) - LINE * (parts.length - 1);
  const leastWidth = Math.min(LEAST_WIDTH, total / parts.length);
  const least = all.map((wish) => (isRow ? leastWidth : wish.least));
  const shares = tree.shares ?? (isRow ? parts.map(() => 1) : undefined);
  const sizes = shares ? byShares(shares, least, total) : byWish(all, total);
  const starts = edges(sizes, isRow ? left : top);
  const end = (isRow ? left + width : top + room) + LINE;
  const boxes = new Map<string, Box>();
  const seams: Seam[] = [];
  parts.forEach((part, k) => {
    const start = starts[k] ?? 0;
    const size = (starts[k + 1] ?? end) - LINE - start;
    const box = isRow ? { left: start, top, width: size, height: room } : { left, top: start, width, height: size };
    if (k + 1 < parts.length) {
      const both = (sizes[k] ?? 0) + (sizes[k + 1] ?? 0);
      const line = isRow
        ? { left: start + size, top, width: LINE, height: room }
        : { left, top: start + size, width, height: LINE };
      seams.push({ path, after: k, along, box: line, sizes, limits: [least[k] ?? 0, both - (least[k + 1] ?? 0)] });
    }
    if (typeof part === "string") return void boxes.set(part, box);
    const inner = arrangement(part, box.width, box.height, wishes, [...path, k], [box.left, box.top]);
    for (const [id, one] of inner.boxes) boxes.set(id, one);
    seams.push(...inner.seams);
  });
  return { boxes, seams, height: room };
}
