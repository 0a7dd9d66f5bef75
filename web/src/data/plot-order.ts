/** The order of the plots and their heights, as a person chose them. Steps from one choice to the next; all are pure. */
import type { PlotOrder } from "./view";

/** Least and greatest height of a plot, px. */
export const PLOT_HEIGHT = [40, 1200] as const;
export const DEFAULT_ORDER: PlotOrder = {};

interface Keyed {
  readonly key: string;
}

/** The plots as a person put them; those without a place stay behind the one that they follow by default. */
export function inOrder<T extends Keyed>(plots: readonly T[], { order }: PlotOrder): readonly T[] {
  if (order === undefined) return plots;
  const known = plots
    .filter(({ key }) => order.includes(key))
    .sort((a, b) => order.indexOf(a.key) - order.indexOf(b.key));
  const placed: T[] = [...known];
  plots.forEach((plot, k) => {
    if (order.includes(plot.key)) return;
    const before = plots[k - 1];
    placed.splice(before ? placed.indexOf(before) + 1 : 0, 0, plot);
  });
  return placed;
}

/** With the plot at place `to` among those on screen. @param keys of the plots on screen, in their order */
export function movedTo(of: PlotOrder, keys: readonly string[], key: string, to: number): PlotOrder {
  const others = keys.filter((one) => one !== key);
  const at = Math.min(Math.max(to, 0), others.length);
  const next = [...others.slice(0, at), key, ...others.slice(at)];
  if (next.every((one, k) => one === keys[k])) return of;
  // plots that are away keep their places at the end
  const away = (of.order ?? []).filter((one) => !next.includes(one));
  return { ...of, order: [...next, ...away] };
}

/** The tile of the plots that were given no other. */
export const PLOTS_TILE = "plots";
export const tileOf = ({ tiles }: PlotOrder, key: string): string => tiles?.[key] ?? PLOTS_TILE;

/** With a plot in another tile. */
export function inTile(of: PlotOrder, key: string, tile: string): PlotOrder {
  const { [key]: _, ...others } = of.tiles ?? {};
  const tiles = tile === PLOTS_TILE ? others : { ...others, [key]: tile };
  const { tiles: __, ...rest } = of;
  return Object.keys(tiles).length > 0 ? { ...rest, tiles } : rest;
}

/** The name of a tile that no plot has yet. */
export function freeTile({ tiles = {} }: PlotOrder): string {
  const taken = new Set(Object.values(tiles));
  let number = 2;
  while (taken.has(`${PLOTS_TILE}/${number}`)) number += 1;
  return `${PLOTS_TILE}/${number}`;
}

export const heightOf = ({ heights }: PlotOrder, key: string): number | undefined => heights?.[key];

/** With that height, px; undefined: the plot takes its share of the room again. */
export function withHeight(of: PlotOrder, key: string, px: number | undefined): PlotOrder {
  const { [key]: _, ...others } = of.heights ?? {};
  const [least, greatest] = PLOT_HEIGHT;
  const heights = px === undefined ? others : { ...others, [key]: Math.round(Math.min(greatest, Math.max(least, px))) };
  const { heights: __, ...rest } = of;
  return Object.keys(heights).length > 0 ? { ...rest, heights } : rest;
}
