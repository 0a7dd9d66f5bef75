/** The part of a workspace with the choices of the XY plot. */
import type { ColumnName, XyChoice } from "../../data/view-state";
import { isObject, type Json, type JsonObject, registerPart } from "../../workspace/parts";

const WORDS = { range: "cursors", colour: "trail", draw: "points", isEqual: true, pairing: "nearest" } as const;

export function isColumnName(json: Json | undefined): json is ColumnName {
  return Array.isArray(json) && json.length === 2 && json.every((part) => typeof part === "string" && part !== "");
}

function isChoice(json: Json): boolean {
  if (!isObject(json) || Object.keys(json).length === 0) return false;
  return Object.entries(json).every(([name, value]) =>
    name === "x" || name === "y" ? isColumnName(value) : Object.hasOwn(WORDS, name) && WORDS[name as never] === value,
  );
}

registerPart<JsonObject>({
  key: "xy",
  read({ viewState: { xy } }) {
    const choice = Object.entries(xy.peek()).sort(([a], [b]) => (a < b ? -1 : 1));
    return choice.length > 0 ? (Object.fromEntries(choice) as JsonObject) : undefined;
  },
  check: (json) => (isChoice(json) ? (json as JsonObject) : undefined),
  write: ({ viewState: { xy } }, json) => void (xy.value = (json ?? {}) as XyChoice),
});
