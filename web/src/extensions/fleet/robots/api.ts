/** Requests of the fleet page. */
import { type Outcome, request } from "../../../ui/http";
import type { DeviceSettingsCheck, FleetEvent, FleetRobots } from "../../../wire/routes";

/** The robots that changed after a revision; all of them without one. */
export function askRobots(after: number | undefined, signal: AbortSignal): Promise<Outcome<FleetRobots>> {
  return request("GET /api/fleet/robots", { query: { after }, signal });
}

/** How many events of a robot are shown. */
const NEWEST = 30;

export const askEvents = (robot: string): Promise<Outcome<readonly FleetEvent[]>> =>
  request("GET /api/fleet/events", { query: { robot, limit: NEWEST } });

export const askSettings = (robot: string): Promise<Outcome<readonly DeviceSettingsCheck[]>> =>
  request("GET /api/fleet/robots/{robot}/settings", { path: { robot } });

export const useProfile = (
  robot: string,
  device: string,
  by: string,
): Promise<Outcome<readonly DeviceSettingsCheck[]>> =>
  request("POST /api/fleet/robots/{robot}/profile", { path: { robot }, body: { device, by } });

export const removeProfile = (
  robot: string,
  device: string,
  by: string,
): Promise<Outcome<readonly DeviceSettingsCheck[]>> =>
  request("DELETE /api/fleet/robots/{robot}/profile", { path: { robot }, query: { device, by } });

export const acknowledge = (robot: string, condition: string, by: string): Promise<Outcome<undefined>> =>
  request("POST /api/fleet/robots/{robot}/acknowledge", { path: { robot }, body: { condition, by } });

export const removeRobot = (robot: string): Promise<Outcome<undefined>> =>
  request("DELETE /api/fleet/robots/{robot}", { path: { robot } });
