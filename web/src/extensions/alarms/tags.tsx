/** The tags of the alarms of a device, in its row of the list of devices. */
import type { AlarmInfo } from "../../wire/routes";
import { alarmCounts, alarmsOf } from "./states";
import { TEXT } from "./texts";

/** Counts of the raised alarms of a device, in its row; nothing while all is well. */
export function AlarmTags({ alarms, device }: { readonly alarms: readonly AlarmInfo[]; readonly device: string }) {
  const { raised, worst, acknowledged, missing } = alarmCounts(alarmsOf(alarms, device));
  if (raised + acknowledged + missing === 0) return null;
  return (
    <span class="why">
      {raised > 0 && (
        <span class={worst === "error" ? "tag bad" : "tag warn"}>
          <span aria-hidden="true">{worst === "error" ? "✖" : "▲"}</span> {TEXT.raisedCount(raised)}
        </span>
      )}
      {acknowledged > 0 && (
        <span>
          <span aria-hidden="true">✓</span> {TEXT.acknowledgedCount(acknowledged)}
        </span>
      )}
      {missing > 0 && (
        <span>
          <span aria-hidden="true">?</span> {TEXT.missingCount(missing)}
        </span>
      )}
    </span>
  );
}
