/** The part of a workspace with the order of the plots and their heights. */
import { DEFAULT_ORDER, PLOT_HEIGHT } from "../data/plot-order";
import type { PlotOrder } from "../data/view";
import { registerPart } from "./parts";
import { isKeys, isNumber, isObject, type Json, type JsonObject } from "../data/json";

function isOrder(json: Json): json is JsonObject {
  if (!isObject(json) || Object.keys(json).length === 0) return false;
  const { order, heights, ...rest } = json;
  const isHeights = (of: Json): boolean =>
    isObject(of) &&
    isKeys(Object.keys(of)) &&
    Object.keys(of).length > 0 &&
    Object.values(of).every((px) => isNumber(px, ...PLOT_HEIGHT));
  return (
    Object.keys(rest).length === 0 &&
    (order === undefined || (isKeys(order) && order.length > 0)) &&
    (heights === undefined || isHeights(heights))
  );
}

registerPart<JsonObject>({
  key: "plotOrder",
  read({ viewState: { plotOrder } }) {
    const { order, heights } = plotOrder.peek();
    if (order === undefined && heights === undefined) return undefined;
    const sorted = heights && Object.fromEntries(Object.entries(heights).sort(([a], [b]) => (a < b ? -1 : 1)));
    return { ...(sorted ? { heights: sorted } : {}), ...(order ? { order: [...order] } : {}) };
  },
  check: (json) => (isOrder(json) ? json : undefined),
  write: ({ viewState: { plotOrder } }, json) => void (plotOrder.value = (json as PlotOrder) ?? DEFAULT_ORDER),
});
