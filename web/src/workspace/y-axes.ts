/** The part of a workspace with the chosen y axes: by plot key a range, and whether it is logarithmic. */
import type { YAxis } from "../data/view";
import { registerPart } from "./parts";
import { isNumber, isObject, type Json, type JsonObject } from "../data/json";

const LARGEST = 1e15;

function axisOf(json: Json): YAxis | undefined {
  if (!isObject(json)) return undefined;
  const { range, isLog } = json;
  if (isLog !== undefined && isLog !== true) return undefined;
  if (range === undefined) return isLog === true ? { isLog } : undefined;
  if (!Array.isArray(range) || range.length !== 2) return undefined;
  const [low, high] = range as readonly (Json | undefined)[];
  if (!isNumber(low, -LARGEST, LARGEST) || !isNumber(high, -LARGEST, LARGEST) || low >= high) return undefined;
  return isLog === true ? { range: [low, high], isLog } : { range: [low, high] };
}

const axesOf = (json: JsonObject): ReadonlyMap<string, YAxis> | undefined => {
  const found = Object.entries(json).map(([key, axis]) => [key, axisOf(axis)] as const);
  const known = found.flatMap(([key, axis]) => (axis ? [[key, axis] as const] : []));
  return known.length === found.length ? new Map(known) : undefined;
};

registerPart<JsonObject>({
  key: "yAxes",
  read({ viewState: { yAxes } }) {
    const axes = [...yAxes.peek()].sort(([a], [b]) => (a < b ? -1 : 1));
    return axes.length > 0 ? (Object.fromEntries(axes) as JsonObject) : undefined;
  },
  check: (json) => (isObject(json) && axesOf(json) ? json : undefined),
  write: ({ viewState: { yAxes } }, json) => void (yAxes.value = (json && axesOf(json)) ?? new Map()),
});
