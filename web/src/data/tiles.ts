/**
 * The tiles of the middle: a tree of rows and columns with panels as its leaves. Steps from one tree to the next; all are pure.
 *
 * A tree names panels that a device may not have, and lacks those that came later: `pruned` gives the one that is drawn.
 */
import { isKeys, isNumber, isObject, type Json } from "./json";

export interface Split {
  readonly along: "row" | "column";
  readonly parts: readonly Tile[];
  /** Sizes of the parts relative to each other, once a person has moved a divider; until then panels have the size they ask for. */
  readonly shares?: readonly number[];
}
/** The id of a panel, or a split. */
export type Tile = string | Split;
/** Heights that a panel asks for, px. */
export interface Wish {
  /** Without scrolling, in its usual size. */
  readonly height: number;
  readonly least: number;
  /** It takes what others leave. */
  readonly grows?: boolean;
}
export type Edge = "left" | "right" | "top" | "bottom";
export const EDGES: readonly Edge[] = ["left", "right", "top", "bottom"];

export const column = (parts: readonly Tile[]): Split => ({ along: "column", parts });

/** The panels of a tree, in reading order. */
export const leaves = (tile: Tile): readonly string[] =>
  typeof tile === "string" ? [tile] : tile.parts.flatMap(leaves);

/** One tile in place of a split with one part; splits within one of their own direction become parts of it. */
function simple(split: Split): Tile | undefined {
  const { along, parts, shares } = split;
  if (parts.length < 2) return parts[0];
  if (!parts.some((part) => typeof part !== "string" && part.along === along)) return split;
  const flat = parts.flatMap((part) => (typeof part !== "string" && part.along === along ? part.parts : [part]));
  if (shares === undefined) return { along, parts: flat };
  const inner = parts.flatMap((part, k) => {
    const whole = shares[k] ?? 1;
    if (typeof part === "string" || part.along !== along) return [whole];
    const own = part.shares ?? part.parts.map(() => 1);
    const sum = own.reduce((all, one) => all + one, 0);
    return own.map((one) => (whole * one) / sum);
  });
  return { along, parts: flat, shares: inner };
}

/** Each part as `step` has it; those that are undefined go, with their shares. */
function mapped(split: Split, step: (part: Tile) => Tile | undefined): Tile | undefined {
  const next = split.parts.map(step);
  const here = <T>(_: T, k: number): boolean => next[k] !== undefined;
  const parts = next.filter((part) => part !== undefined);
  const shares = split.shares?.filter(here);
  return simple({ along: split.along, parts, ...(shares ? { shares } : {}) });
}

/** Without a panel; undefined if nothing is left. */
export const without = (tile: Tile, id: string): Tile | undefined =>
  typeof tile === "string" ? (tile === id ? undefined : tile) : mapped(tile, (part) => without(part, id));

/** The tree of the panels that are shown: without the others, and with those that it does not name at its lower end. */
export function pruned(tree: Tile | undefined, ids: readonly string[]): Split {
  const named = tree === undefined ? [] : leaves(tree);
  let shown = tree;
  for (const id of named) if (!ids.includes(id) && shown !== undefined) shown = without(shown, id);
  const late = ids.filter((id) => !named.includes(id));
  const root = shown === undefined ? column([]) : typeof shown === "string" ? column([shown]) : shown;
  if (late.length === 0) return root;
  if (root.along === "row") return column([root, ...late]);
  const { shares } = root;
  const average = shares && shares.reduce((sum, one) => sum + one, 0) / shares.length;
  return {
    ...root,
    parts: [...root.parts, ...late],
    ...(shares && average ? { shares: [...shares, ...late.map(() => average)] } : {}),
  };
}

/** With a panel at an edge of another one, which gives it half of its room, or of the whole. A panel beside itself stays. */
export function beside(tree: Split, id: string, target: string | undefined, edge: Edge): Split {
  const along = edge === "left" || edge === "right" ? "row" : "column";
  const isBefore = edge === "left" || edge === "top";
  const rest = id === target ? tree : without(tree, id);
  if (id === target || rest === undefined) return tree;
  if (target !== undefined && !leaves(rest).includes(target)) return tree;
  const split = (tile: Tile): Tile => simple({ along, parts: isBefore ? [id, tile] : [tile, id] }) ?? tile;
  const insert = (tile: Tile): Tile => {
    if (typeof tile === "string") return tile === target ? split(tile) : tile;
    return mapped(tile, insert) ?? tile;
  };
  const next = target === undefined ? split(rest) : insert(rest);
  return typeof next === "string" ? column([next]) : next;
}

/** With one panel in the place of another, and the other way round. */
export function exchanged(tree: Split, a: string, b: string): Split {
  const swap = (tile: Tile): Tile =>
    typeof tile === "string" ? (tile === a ? b : tile === b ? a : tile) : { ...tile, parts: tile.parts.map(swap) };
  return swap(tree) as Split;
}

/** With these shares of a split. @param path places of parts, from the root */
export function withShares(tree: Split, path: readonly number[], shares: readonly number[] | undefined): Split {
  const [first, ...rest] = path;
  if (first === undefined) {
    const { shares: _, ...bare } = tree;
    return shares === undefined ? bare : { ...bare, shares };
  }
  const part = tree.parts[first];
  if (part === undefined || typeof part === "string") return tree;
  return { ...tree, parts: tree.parts.map((one, k) => (k === first ? withShares(part, rest, shares) : one)) };
}

/** Splits within splits, at most: more than there are panels, each of which may add one. */
const MAX_DEPTH = 64;

/** The tree that JSON describes; undefined if it describes none. */
export function tilesOf(json: Json): Split | undefined {
  const isTile = (of: Json | undefined, depth: number): boolean => {
    if (typeof of === "string") return isKeys([of]);
    if (depth > MAX_DEPTH || of === undefined || !isObject(of)) return false;
    const { along, parts, shares, ...rest } = of;
    return (
      Object.keys(rest).length === 0 &&
      (along === "row" || along === "column") &&
      Array.isArray(parts) &&
      parts.length > 0 &&
      parts.every((part) => isTile(part, depth + 1)) &&
      (shares === undefined ||
        (Array.isArray(shares) &&
          shares.length === parts.length &&
          shares.every((share) => isNumber(share as Json, 0.001, 1e5))))
    );
  };
  if (typeof json === "string" || !isTile(json, 0)) return undefined;
  const tree = json as unknown as Split;
  const ids = leaves(tree);
  return new Set(ids).size === ids.length ? tree : undefined;
}
