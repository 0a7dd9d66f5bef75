/** The address of the fleet page: a link shows the same robots in the same order. Pure. */
import { columnNamed } from "./columns";
import { type RobotChoice, GROUPINGS, SHOWN, WORST_FIRST } from "./order";

export interface FleetPlace extends RobotChoice {
  readonly view: "list" | "map";
  /** The robot whose details are open, or "". */
  readonly robot: string;
}

export const START: FleetPlace = { ...WORST_FIRST, view: "list", robot: "" };

const one = <T extends string>(all: readonly T[], value: string | null, other: T): T =>
  all.find((name) => name === value) ?? other;

/** The place of a query; what is missing or unknown is as at the start. */
export function readRobotPlace(query: string): FleetPlace {
  const given = new URLSearchParams(query);
  const column = columnNamed(given.get("sort") ?? START.sort) ?? columnNamed(START.sort);
  const order = given.get("order");
  return {
    sort: column?.name ?? START.sort,
    descending: order === "down" || order === "up" ? order === "down" : (column?.largestFirst ?? true),
    shown: one(SHOWN, given.get("show"), START.shown),
    query: given.get("q") ?? "",
    grouping: one(GROUPINGS, given.get("by"), START.grouping),
    view: given.get("view") === "map" ? "map" : "list",
    robot: given.get("robot") ?? "",
  };
}

export function fleetHref(place: FleetPlace): string {
  const query = new URLSearchParams();
  const usual = columnNamed(place.sort)?.largestFirst ?? true;
  if (place.sort !== START.sort) query.set("sort", place.sort);
  if (place.descending !== usual) query.set("order", place.descending ? "down" : "up");
  if (place.shown !== START.shown) query.set("show", place.shown);
  if (place.query !== "") query.set("q", place.query);
  if (place.grouping !== START.grouping) query.set("by", place.grouping);
  if (place.view !== START.view) query.set("view", place.view);
  if (place.robot !== "") query.set("robot", place.robot);
  const text = query.toString();
  return text === "" ? "#/fleet" : `#/fleet?${text}`;
}
