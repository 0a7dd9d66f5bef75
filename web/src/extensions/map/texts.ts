/** Texts of the enlarged track and its map. */
import type { Value } from "../../texts/plural";

export const TEXT = {
  track: "Track",
  trackHelp: "Track on a metric grid, north up. Arrow keys move it, plus and minus zoom, 0 fits.",
  fixTypes: "Fix types",
  zoomIn: "Zoom in",
  zoomOut: "Zoom out",
  fit: "Fit",
  fitHint: "Fit: show the entire window and follow it",
  noPosition: "no position",
  mapLabel: "Map under the track",
  map: "Map",
  tileServerDown: "The tile server does not respond.",
  trackOf: (name: Value) => `Track of ${name}`,
};
