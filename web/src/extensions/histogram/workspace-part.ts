/** The part of a workspace with the choices of the histogram. */
import type { HistogramChoice } from "../../data/view-state";
import { BINS, SIGMAS } from "./limits";
import { isKeys, isNumber, isObject, type Json, type JsonObject, registerPart } from "../../workspace/parts";

const CHECKS: Readonly<Record<keyof HistogramChoice, (json: Json) => boolean>> = {
  channel: (json) => isKeys([json]),
  columns: (json) => isKeys(json) && json.length > 0,
  range: (json) => json === "cursors",
  scale: (json) => json === "density",
  bins: (json) => isNumber(json, ...BINS) && Number.isInteger(json),
  within: (json) => isNumber(json, ...SIGMAS),
  noCurve: (json) => json === true,
};

function isChoice(json: Json): json is JsonObject {
  if (!isObject(json) || Object.keys(json).length === 0) return false;
  return Object.entries(json).every(
    ([name, value]) => Object.hasOwn(CHECKS, name) && CHECKS[name as keyof HistogramChoice](value),
  );
}

registerPart<JsonObject>({
  key: "histogram",
  read({ viewState: { histogram } }) {
    const choice = Object.entries(histogram.peek()).sort(([a], [b]) => (a < b ? -1 : 1));
    return choice.length > 0 ? (Object.fromEntries(choice) as JsonObject) : undefined;
  },
  check: (json) => (isChoice(json) ? json : undefined),
  write: ({ viewState: { histogram } }, json) => void (histogram.value = (json ?? {}) as HistogramChoice),
});
