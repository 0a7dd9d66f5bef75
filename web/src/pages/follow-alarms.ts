/** The list of alarms, kept up to date. */
import { effect } from "@preact/signals";
import { notifyRaised } from "../panels/alarm-notices";
import { request } from "../ui/http";
import type { App } from "./app-state";

const REFRESH_MS = 2000;

/** Loads the alarms now, after each event of one, and while there are any every two seconds, for values and pending ones. */
export function followAlarms(app: App): () => void {
  const load = async (): Promise<void> => {
    const outcome = await request("GET /api/alarms");
    if (outcome.ok) app.alarms.value = outcome.value;
  };
  let seen = -1;
  const stop = effect(() => {
    if (app.store.connection.value !== "open") return;
    const last = app.store.events.value.findLast(({ kind }) => kind === "alarm")?.seq ?? 0;
    if (last === seen) return;
    if (seen >= 0) notifyRaised(app.store.events.value, seen, app.store.serverNow());
    seen = last;
    void load();
  });
  const timer = setInterval(() => {
    if (app.alarms.peek().length > 0 && document.visibilityState === "visible") void load();
  }, REFRESH_MS);
  return () => {
    clearInterval(timer);
    stop();
  };
}
