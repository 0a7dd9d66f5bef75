/**
 * Where the panels of a view are: which are shown, in which part of the page, in which order and how large. Steps from one layout to
 * the next; all are pure. A layout holds only what a person chose, so that a new panel, and one that a device has later, gets its
 * default place.
 */
import { isKeys, isNumber, isObject, type Json, type JsonObject } from "./json";
import {
  beside,
  column,
  type Edge,
  exchanged,
  leaves,
  pruned,
  type Split,
  tilesOf,
  without,
  withShares,
} from "./tiles";

/** The middle of the page, the side column, and the scrolling part of that column. */
export type Area = "main" | "side" | "below";
export const AREAS: readonly Area[] = ["main", "side", "below"];

/** What was chosen for a panel. */
export interface PanelChoice {
  readonly area?: Area;
  readonly shown?: boolean;
  /** px */
  readonly height?: number;
}

export interface Layout {
  readonly panels: Readonly<Record<string, PanelChoice>>;
  /** Panels of an area in order, if the user has changed it. */
  readonly order: { readonly [area in Area]?: readonly string[] };
  /** Of the side column, px. */
  readonly sideWidth?: number;
  /** Of the scrolling part of the side column, px. */
  readonly belowHeight?: number;
  /** The panel that has the whole page. */
  readonly maximised?: string;
  /** The middle, once a person has put panels beside each other; until then they are below each other, in their order. */
  readonly tiles?: Split;
}

/** A panel as a layout sees it. */
export interface PanelPlacement {
  readonly id: string;
  readonly where: string;
  /** Shown on request only. */
  readonly optional?: boolean;
}

export const DEFAULT_LAYOUT: Layout = { panels: {}, order: {} };
/** Least and greatest sizes, px. */
export const SIDE_WIDTH = [240, 720] as const;
export const HEIGHT = [60, 2000] as const;

export const areaOf = ({ panels }: Layout, { id, where }: PanelPlacement): string => panels[id]?.area ?? where;
export const isShown = ({ panels }: Layout, { id, optional }: PanelPlacement): boolean =>
  panels[id]?.shown ?? optional !== true;

/** The panels of an area in order: as a person put them, then the others by default. @param all in their default order */
export function inArea<T extends PanelPlacement>(layout: Layout, area: Area, all: readonly T[]): readonly T[] {
  const here = all.filter((panel) => areaOf(layout, panel) === area && isShown(layout, panel));
  const order = area === "main" && layout.tiles ? leaves(layout.tiles) : layout.order[area];
  if (order === undefined) return here;
  return [...here.filter(({ id }) => order.includes(id))]
    .sort((a, b) => order.indexOf(a.id) - order.indexOf(b.id))
    .concat(here.filter(({ id }) => !order.includes(id)));
}

/** Set something of a panel; undefined removes the choice. */
function choose(
  layout: Layout,
  id: string,
  part: { readonly [name in keyof PanelChoice]: PanelChoice[name] | undefined },
) {
  const choice = Object.fromEntries(
    Object.entries({ ...layout.panels[id], ...part }).filter(([, value]) => value !== undefined),
  );
  const { [id]: _, ...others } = layout.panels;
  return { ...layout, panels: Object.keys(choice).length > 0 ? { ...others, [id]: choice } : others };
}

export function show<T extends PanelPlacement>(layout: Layout, panel: T, shown: boolean): Layout {
  const next = choose(layout, panel.id, { shown: shown === (panel.optional !== true) ? undefined : shown });
  return !shown && layout.maximised === panel.id ? maximise(next, undefined) : next;
}

const idsIn = <T extends PanelPlacement>(layout: Layout, area: Area, all: readonly T[]): readonly string[] =>
  inArea(layout, area, all).map(({ id }) => id);

/** Assign a panel to an area, without a place in it yet. */
function assigned(layout: Layout, panel: PanelPlacement, area: Area): Layout {
  const was = areaOf(layout, panel) as Area;
  if (was === area) return layout;
  // A height applies to its own area only.
  const moved = choose(layout, panel.id, { area: area === panel.where ? undefined : area, height: undefined });
  const left = layout.order[was] ? { [was]: layout.order[was].filter((id) => id !== panel.id) } : {};
  const { tiles, ...rest } = { ...moved, order: { ...layout.order, ...left } };
  const others = tiles && without(tiles, panel.id);
  return others === undefined ? rest : { ...rest, tiles: typeof others === "string" ? column([others]) : others };
}

/** Move a panel to place `at` of an area; default: its end. @param all in their default order */
export function moveTo<T extends PanelPlacement>(
  layout: Layout,
  panel: T,
  area: Area,
  all: readonly T[],
  at = Infinity,
): Layout {
  const others = idsIn(layout, area, all).filter((id) => id !== panel.id);
  const index = Math.min(Math.max(at, 0), others.length);
  const [next, last] = [others[index], others.at(-1)];
  if (area === "main" && layout.tiles && last !== undefined)
    return tile(layout, panel, next ?? last, next === undefined ? "bottom" : "top", all);
  const moved = assigned(layout, panel, area);
  const order = [...others.slice(0, index), panel.id, ...others.slice(index)];
  return { ...moved, order: { ...moved.order, [area]: order } };
}

/** Move a panel by `steps` within its area. */
export function moveBy<T extends PanelPlacement>(layout: Layout, panel: T, steps: number, all: readonly T[]): Layout {
  const area = areaOf(layout, panel) as Area;
  const ids = idsIn(layout, area, all);
  const to = ids.indexOf(panel.id) + steps;
  const other = ids[to];
  if (to < 0 || other === undefined) return layout;
  if (area !== "main" || !layout.tiles) return moveTo(layout, panel, area, all, to);
  return { ...layout, tiles: exchanged(pruned(layout.tiles, ids), panel.id, other) };
}

/** Move a panel to an edge of another one of the middle, or of the whole middle. @param all in their default order */
export function tile<T extends PanelPlacement>(
  layout: Layout,
  panel: T,
  target: string | undefined,
  edge: Edge,
  all: readonly T[],
): Layout {
  const moved = assigned(layout, panel, "main");
  return { ...moved, tiles: beside(treeOf(moved, all), panel.id, target, edge) };
}

/** The tiles of the middle. @param all in their default order */
export const treeOf = <T extends PanelPlacement>(layout: Layout, all: readonly T[]): Split =>
  pruned(layout.tiles, idsIn(layout, "main", all));

/** Set the sizes of the parts of a split of the middle; undefined: each has the size it asks for. */
export const setShares = <T extends PanelPlacement>(
  layout: Layout,
  path: readonly number[],
  shares: readonly number[] | undefined,
  all: readonly T[],
): Layout => ({ ...layout, tiles: withShares(treeOf(layout, all), path, shares) });

const within = ([least, greatest]: readonly [number, number], px: number): number =>
  Math.round(Math.min(greatest, Math.max(least, px)));

export const setHeight = (layout: Layout, id: string, px: number | undefined): Layout =>
  choose(layout, id, { height: px === undefined ? undefined : within(HEIGHT, px) });

export function setSize(layout: Layout, name: "sideWidth" | "belowHeight", px: number | undefined): Layout {
  const { [name]: _, ...rest } = layout;
  return px === undefined ? rest : { ...rest, [name]: within(name === "sideWidth" ? SIDE_WIDTH : HEIGHT, px) };
}

export function maximise(layout: Layout, id: string | undefined): Layout {
  const { maximised: _, ...rest } = layout;
  return id === undefined ? rest : { ...rest, maximised: id };
}

/** A layout as JSON, in one order of keys; undefined for the default. */
export function layoutJson({ panels, order, tiles, ...rest }: Layout): JsonObject | undefined {
  const sorted = Object.fromEntries(
    Object.entries(panels)
      .sort(([a], [b]) => (a < b ? -1 : 1))
      .map(([id, choice]) => [id, { ...choice }]),
  );
  const lists = Object.fromEntries(AREAS.flatMap((area) => (order[area] ? [[area, [...order[area]]]] : [])));
  const json = {
    ...(Object.keys(sorted).length > 0 ? { panels: sorted } : {}),
    ...(Object.keys(lists).length > 0 ? { order: lists } : {}),
    ...rest,
    ...(tiles ? { tiles: tiles as unknown as JsonObject } : {}),
  };
  return Object.keys(json).length > 0 ? json : undefined;
}

const NAMES: ReadonlySet<string> = new Set(["panels", "order", "sideWidth", "belowHeight", "maximised", "tiles"]);

/** The layout that JSON describes; undefined if it describes none. */
export function layoutOf(json: Json): Layout | undefined {
  if (!isObject(json) || !Object.keys(json).every((name) => NAMES.has(name))) return undefined;
  const { panels = {}, order = {}, sideWidth, belowHeight, maximised, tiles } = json;
  const fits =
    isObject(panels) &&
    isKeys(Object.keys(panels)) &&
    Object.values(panels).every(isChoice) &&
    isObject(order) &&
    Object.entries(order).every(([area, ids]) => AREAS.includes(area as Area) && isKeys(ids)) &&
    (sideWidth === undefined || isNumber(sideWidth, ...SIDE_WIDTH)) &&
    (belowHeight === undefined || isNumber(belowHeight, ...HEIGHT)) &&
    (maximised === undefined || isKeys([maximised])) &&
    (tiles === undefined || tilesOf(tiles) !== undefined);
  return fits ? ({ ...json, panels, order } as unknown as Layout) : undefined;
}

function isChoice(json: Json): boolean {
  if (!isObject(json)) return false;
  const { area, shown, height, ...rest } = json;
  return (
    Object.keys(rest).length === 0 &&
    (area === undefined || AREAS.includes(area as Area)) &&
    (shown === undefined || typeof shown === "boolean") &&
    (height === undefined || isNumber(height, ...HEIGHT))
  );
}
