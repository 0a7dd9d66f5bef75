/** Data that are refused or shown without a check, and what to do about it: bands of their own, never on the data. */
import { keyWanted, keyWrong, trustOf } from "../panels/authenticity";
import { api } from "../ui/http";
import { Message } from "../ui/message";
import { type App, askKey, linkOf, run } from "./app-state";

/** Secure devices on the link of the selected one that restarted: their frames are refused until an operator re-arms them. */
export function RearmBand({ app }: { readonly app: App }) {
  const device = app.device.value;
  if (!device) return null;
  const link = app.store.devices.value.find(({ id }) => id === linkOf(device)) ?? device;
  return (
    <>
      {link.rearm.map((sender) => (
        <div class="band caution" role="status" data-rearm={sender} key={sender}>
          <span class="dot warn" />
          <b>Sequence of {sender} restarted</b>
          <span class="mid">
            Device {sender} sends old sequence numbers, which Secure mode refuses. Re-arm it if you restarted it. If nobody did, somebody may be playing
            captured frames again.
          </span>
          <span class="grow" />
          <button type="button" class="btn edge" onClick={() => void run(api.rearmDevice(link.id, sender))}>
            Re-arm {sender}
          </button>
        </div>
      ))}
    </>
  );
}

/** For the selected device: frames that need a key, a key that does not fit, or data that nobody could check. */
export function KeyBand({ app }: { readonly app: App }) {
  const device = app.device.value;
  if (!device) return null;
  const health = app.store.health.value.get(device.id);
  const unverified = trustOf(device, health)?.word === "unverified" && device.protocol !== "";
  const refused = keyWanted(health) || keyWrong(health);
  if (!unverified && refused === "") return null;
  return (
    <div class="band caution" role="status" data-key="wanted">
      <span class="dot warn" />
      <b>{unverified ? "Shown unverified" : "A key is needed"}</b>
      <span class="mid">
        {unverified ? "Nobody could check who sent these data. " : <Message text={`${refused} `} />}
        Give the key here, or start with <code>--key</code>.
      </span>
      <span class="grow" />
      <button type="button" class="btn edge" onClick={() => askKey(device)}>
        Give the key…
      </button>
    </div>
  );
}
