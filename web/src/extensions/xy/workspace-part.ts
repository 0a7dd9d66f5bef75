/** The part of a workspace with the choices of the XY plot. */
import type { ColumnName, XyChoice } from "../../data/view";
import { registerChoices } from "../../workspace/parts";
import type { Json } from "../../data/json";

function isColumnName(json: Json | undefined): json is ColumnName {
  return Array.isArray(json) && json.length === 2 && json.every((part) => typeof part === "string" && part !== "");
}

registerChoices<XyChoice>("xy", ({ xy }) => xy, {
  x: isColumnName,
  y: isColumnName,
  range: (json) => json === "cursors",
  colour: (json) => json === "trail",
  draw: (json) => json === "points",
  isEqual: (json) => json === true,
  pairing: (json) => json === "nearest",
});
