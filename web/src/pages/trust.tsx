/** Data that are refused or shown without a check, and what to do about it: bands of their own, never on the data. */
import { keyWanted, keyWrong, trustOf } from "../panels/trust";
import { type App, askKey } from "./app";

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
        {unverified ? "Nobody could check who sent these data. " : `${refused} `}
        Give the key here, or start with <code>--key</code>.
      </span>
      <span class="grow" />
      <button type="button" class="btn edge" onClick={() => askKey(device)}>
        Give the key…
      </button>
    </div>
  );
}
