/** The list of alarms, kept up to date. */
import { effect } from "@preact/signals";
import type { App } from "../../page/context";
import { request } from "../../requests/http";
import { alarmList } from "./list";
import { notifyRaised } from "./notices";

const REFRESH_MS = 2000;

/** Loads the alarms now, after each event of one, and while there are any every two seconds, for values and pending ones. */
export function followAlarms(app: App): () => void {
  const list = alarmList(app.store);
  let turn = 0;
  const load = async (): Promise<void> => {
    const [mine, before] = [++turn, list.peek()];
    const outcome = await request("GET /api/alarms");
    // overtaken by a later one, or by a change such as an acknowledgement, which it would show undone
    if (mine !== turn || list.peek() !== before) return;
    if (outcome.ok) list.value = outcome.value;
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
    if (list.peek().length > 0 && document.visibilityState === "visible") void load();
  }, REFRESH_MS);
  return () => {
    clearInterval(timer);
    stop();
  };
}
