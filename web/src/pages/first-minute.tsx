/** The first minute with simulators alone: one line that leads to a sensor, a file and a tour of the page, until it is dismissed. */
import { signal } from "@preact/signals";
import { perApp } from "../page/app-state";
import type { App } from "../page/context";
import { Band } from "../ui/controls/band";
import { Button } from "../ui/controls/button";
import { IconButton } from "../ui/controls/icon-button";
import { late } from "../ui/dom/late";
import { OpenFile } from "./open-file";
import { TEXT } from "../texts/live";

const KEY = "imuscope.first-minute";
const LateTour = late(async () => (await import("./tour")).Tour);

function remembered(): boolean {
  try {
    return localStorage.getItem(KEY) !== null;
  } catch {
    return false; // storage is blocked: it is dismissed for this load alone
  }
}

/** Whether the line was dismissed, and whether the tour is shown. */
const stateOf = perApp(() => ({ isDismissed: signal(remembered()), isTouring: signal(false) }));

export function FirstMinute({ app }: { readonly app: App }) {
  const { isDismissed, isTouring } = stateOf(app);
  const devices = app.store.devices.value;
  const dismiss = (): void => {
    isDismissed.value = true;
    try {
      localStorage.setItem(KEY, "dismissed");
    } catch {
      // not remembered then
    }
  };
  return (
    <>
      {!isDismissed.value && devices.length > 0 && devices.every(({ simulated }) => simulated) && (
        <Band tone="calm" dot="off" title={TEXT.simulatedSensors(devices.length)} data-key="first-minute">
          <Button changes look="small" words={TEXT.connectYours} onClick={() => (app.overlay.value = "add")} />
          <OpenFile app={app} look="small" />
          <Button look="small" words={TEXT.whatIsThis} onClick={() => (isTouring.value = true)} />
          <span class="grow" />
          <IconButton icon="close" label={TEXT.dismiss} onClick={dismiss} />
        </Band>
      )}
      {isTouring.value && <LateTour onClose={() => (isTouring.value = false)} />}
    </>
  );
}
