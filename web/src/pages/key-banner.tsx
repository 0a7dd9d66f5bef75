/** Bands for refused or unverified data and the remedy, never over the data. */
import { keyWanted, keyWrong, trustOf } from "../panels/authenticity";
import { Button } from "../ui/controls/button";
import { api } from "../requests/http";
import { Band } from "../ui/controls/band";
import { Message } from "../ui/controls/message";
import { askKey, linkOf, run } from "../page/app-state";
import type { App } from "../page/context";
import { TEXT } from "../texts/live";

/** Secure devices on the link of the selected one that restarted: their frames are refused until an operator re-arms them. */
export function RearmBand({ app }: { readonly app: App }) {
  const device = app.device.value;
  if (!device) return null;
  const link = app.store.devices.value.find(({ id }) => id === linkOf(device)) ?? device;
  return (
    <>
      {link.rearm.map((sender) => (
        <Band
          key={sender}
          tone="warning"
          dot="warn"
          title={TEXT.sequenceRestarted(sender)}
          words={TEXT.oldSequenceNumbers(sender)}
          data-rearm={sender}
        >
          <Button
            changes
            look="edge"
            words={TEXT.rearm(sender)}
            onClick={() => void run(app, api.rearmDevice(link.id, sender))}
          />
        </Band>
      ))}
    </>
  );
}

/** For the selected device: frames that need a key, a wrong key, or data that could not be verified. */
export function KeyBand({ app }: { readonly app: App }) {
  const device = app.device.value;
  if (!device) return null;
  const health = app.store.health.value.get(device.id);
  const unverified = trustOf(device, health)?.state === "unverified" && device.protocol !== "";
  const refused = keyWanted(health) || keyWrong(health);
  if (!unverified && refused === "") return null;
  const words = (
    <>
      {unverified ? TEXT.unverifiedData : <Message text={`${refused} `} />}
      {TEXT.enterKeyHere} <code>{TEXT.keyOption}</code>.
    </>
  );
  const title = unverified ? TEXT.shownUnverified : TEXT.keyNeeded;
  return (
    <Band tone="warning" dot="warn" title={title} words={words} data-key="wanted">
      <Button changes look="edge" words={TEXT.enterKey} onClick={() => askKey(app, device)} />
    </Band>
  );
}
