/** Requests of the fleet page. */
import { type Outcome, request } from "../ui/http";
import type { FleetRobots } from "../wire/routes";

/** The robots that changed after a revision; all of them without one. */
export function askRobots(after: number | undefined, signal: AbortSignal): Promise<Outcome<FleetRobots>> {
  return request("GET /api/fleet/robots", { query: { after }, signal });
}
