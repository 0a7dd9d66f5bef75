/** Whether the server is that of a fleet, whose page opens with its robots, and whether it answers questions about a store. */
import { signal } from "@preact/signals";
import { perApp } from "../../page/app-state";
import type { App } from "../../page/context";
import { go } from "../../page/route";
import { request } from "../../requests/http";

const RETRY_MS = 2000;

export const serverKind = perApp(() => ({
  isFleet: signal(false),
  /** Whether it answers questions about a store of recordings. */
  hasStore: signal(false),
}));

/** Asks the server, again while it does not respond. A page without an address of its own then goes to the robots. */
export async function askServerKind(app: App): Promise<void> {
  const outcome = await request("GET /api/build");
  if (!outcome.ok) {
    if (outcome.problem.status === 0) setTimeout(() => void askServerKind(app), RETRY_MS);
    return;
  }
  serverKind(app).isFleet.value = outcome.value.fleet;
  if (outcome.value.fleet && location.hash === "") go("fleet");
  if (!(outcome.value.absent ?? []).includes("fleet")) void findStore(app);
}

async function findStore(app: App): Promise<void> {
  const outcome = await request("GET /api/query");
  if (outcome.ok) serverKind(app).hasStore.value = outcome.value.store !== "";
}
