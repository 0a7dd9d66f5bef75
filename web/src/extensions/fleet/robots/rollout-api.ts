/** Requests about rollouts. */
import { type Outcome, request } from "../../../ui/http";
import type { Rollout, RolloutHead, RolloutPlan, RolloutRequest } from "../../../wire/routes";

export const askPlan = (robot: string, device: string, waves: string): Promise<Outcome<RolloutPlan>> =>
  request("GET /api/fleet/robots/{robot}/rollout", { path: { robot }, query: { device, waves } });

export const startRollout = (robot: string, body: RolloutRequest): Promise<Outcome<Rollout>> =>
  request("POST /api/fleet/robots/{robot}/rollout", { path: { robot }, body });

export const askRollouts = (): Promise<Outcome<readonly RolloutHead[]>> => request("GET /api/fleet/rollouts", {});

export const askRollout = (rollout: number): Promise<Outcome<Rollout>> =>
  request("GET /api/fleet/rollouts/{rollout}", { path: { rollout } });

export const stopRollout = (rollout: number, by: string): Promise<Outcome<Rollout>> =>
  request("POST /api/fleet/rollouts/{rollout}/stop", { path: { rollout }, body: { by } });
