/** The width of the side column, for the page's grid. */
import type { ViewState } from "../data/view-state";

export function sideWidthOf({ layout }: ViewState): Record<string, string> {
  const { sideWidth } = layout.value;
  return sideWidth === undefined ? {} : { "--side-w": `min(${sideWidth}px, 50vw)` };
}
