/** The panels of a view as its layout has them. */
import { arrangedPanels, type PanelDefinition } from "../panels/registry";
import { PLOTS_TILE, tileOf } from "../data/plot-order";
import type { Deps } from "../page/context";
import { COMMON } from "../texts/common";
import { type Area, inArea } from "../data/layout";

/** Plots: each page mounts them in its own way. They stay in the middle, and shown. @param id of their tile */
export const plotsPanel = (id: string): PanelDefinition => ({
  id,
  title: id === PLOTS_TILE ? COMMON.plots : `${COMMON.plots} ${id.slice(PLOTS_TILE.length + 1)}`,
  where: "main",
  order: 10,
  isWide: true,
  mount: () => ({ update: () => undefined, dispose: () => undefined }),
});
const PLOTS = plotsPanel(PLOTS_TILE);

export const isPlotsTile = (id: string): boolean => id === PLOTS_TILE || id.startsWith(`${PLOTS_TILE}/`);

/** Every panel that applies, in default order. Reads signals: call it while a component is rendered. */
export function panelsOf(deps: Deps): readonly PanelDefinition[] {
  const all = arrangedPanels(deps);
  const { plotOrder, plotsWish } = deps.viewState;
  const tiles = new Set(plotsWish.value.keys.map((key) => tileOf(plotOrder.value, key)));
  tiles.delete(PLOTS_TILE);
  const isBefore = ({ where, order }: PanelDefinition): boolean => where === "main" && order < PLOTS.order;
  return [...all.filter(isBefore), PLOTS, ...[...tiles].map(plotsPanel), ...all.filter((panel) => !isBefore(panel))];
}

/** The panels of an area in their order. Reads signals. */
export function panelsHere(area: Area, deps: Deps): readonly PanelDefinition[] {
  return inArea(deps.viewState.layout.value, area, panelsOf(deps));
}
