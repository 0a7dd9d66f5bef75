/** The part of a workspace with the choices of the histogram. */
import type { HistogramChoice } from "../../data/view";
import { registerChoices } from "../../workspace/parts";
import { isKeys, isNumber } from "../../data/json";

/** Limits of what is set of a histogram, as the server has them (server/extensions/analysis/methods/histogram.py). */
const BINS = [1, 2000] as const;
const SIGMAS = [0.5, 100] as const;

registerChoices<HistogramChoice>("histogram", ({ histogram }) => histogram, {
  channel: (json) => isKeys([json]),
  columns: (json) => isKeys(json) && json.length > 0,
  range: (json) => json === "cursors",
  scale: (json) => json === "density",
  bins: (json) => isNumber(json, ...BINS) && Number.isInteger(json),
  within: (json) => isNumber(json, ...SIGMAS),
  noCurve: (json) => json === true,
});
