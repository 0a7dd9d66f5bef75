/** The panels of a view as its layout has them. */
import { arrangedPanels, type PanelDefinition } from "../panels/registry";
import type { Deps } from "../page/context";
import { COMMON } from "../texts/common";
import { type Area, inArea } from "../data/layout";

/** The plots: each page mounts them in its own way. They stay in the middle, and shown. */
export const PLOTS: PanelDefinition = {
  id: "plots",
  title: COMMON.plots,
  where: "main",
  order: 10,
  isWide: true,
  mount: () => ({ update: () => undefined, dispose: () => undefined }),
};

/** Every panel that applies, in default order. Reads signals: call it while a component is rendered. */
export function panelsOf(deps: Deps): readonly PanelDefinition[] {
  const all = arrangedPanels(deps);
  const isBefore = ({ where, order }: PanelDefinition): boolean => where === "main" && order < PLOTS.order;
  return [...all.filter(isBefore), PLOTS, ...all.filter((panel) => !isBefore(panel))];
}

/** The panels of an area in their order. Reads signals. */
export function panelsHere(area: Area, deps: Deps): readonly PanelDefinition[] {
  return inArea(deps.viewState.layout.value, area, panelsOf(deps));
}
