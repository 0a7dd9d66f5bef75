/** The part of a workspace with the choices of the histogram. */
import type { HistogramChoice } from "../../data/view";
import { BINS, SIGMAS } from "./limits";
import { registerChoices } from "../../workspace/parts";
import { isKeys, isNumber } from "../../data/json";

registerChoices<HistogramChoice>("histogram", ({ histogram }) => histogram, {
  channel: (json) => isKeys([json]),
  columns: (json) => isKeys(json) && json.length > 0,
  range: (json) => json === "cursors",
  scale: (json) => json === "density",
  bins: (json) => isNumber(json, ...BINS) && Number.isInteger(json),
  within: (json) => isNumber(json, ...SIGMAS),
  noCurve: (json) => json === true,
});
