/** The alarms of the server, with their states, and the form of one. */
import { signal } from "@preact/signals";
import type { Store } from "../../data/store";
import { madeFor } from "../../page/app-state";
import type { App, Openers } from "../../page/context";
import type { AlarmInfo } from "../../wire/routes";
import type { AlarmDraft } from "./states";

/** Alarms as the page of a live store has them; none over a recording, whose store has no states. */
export const alarmList = madeFor((_store: Store) => signal<readonly AlarmInfo[]>([]));

/** Opens the form of an alarm: a new one as far as it is known, or a stored one. */
export const openAlarm = (open: Pick<Openers, "dialog">, draft: AlarmDraft): void =>
  open.dialog("alarms/dialog", draft);

/** What is known of the alarm whose form is open. */
export const draftOf = ({ subject }: App): AlarmDraft => subject.value ?? {};
