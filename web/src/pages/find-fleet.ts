/** Whether this is the server of a fleet, whose page opens with its robots. */
import { request } from "../ui/http";
import type { App } from "./app-state";
import { go } from "./route";

const RETRY_MS = 2000;

/** Asks the server, again while it does not respond. A page without an address of its own then goes to the robots. */
export async function findFleet(app: App): Promise<void> {
  const outcome = await request("GET /api/build");
  if (!outcome.ok) {
    if (outcome.problem.status === 0) setTimeout(() => void findFleet(app), RETRY_MS);
    return;
  }
  app.isFleet.value = outcome.value.fleet;
  if (app.isFleet.value && location.hash === "") go("fleet");
}
