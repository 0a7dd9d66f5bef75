/** The link to what is on screen on Live: a button and its key. */
import { signal } from "@preact/signals";
import { Icon } from "../ui/icons";
import { copyLiveLink } from "./live-address";

/** How long the button says that the link was copied, ms. */
const SAID_MS = 2500;
const said = signal("");

export async function shareLive(): Promise<void> {
  said.value = (await copyLiveLink()) ? "Link copied" : "The browser does not let the page copy: the address above is the link";
  setTimeout(() => (said.value = ""), SAID_MS);
}

export function Share() {
  return (
    <>
      <button type="button" class={`btn icon desk flag share ${said.value ? "just" : ""}`} aria-label="Copy link" title={said.value || "Copy the link to what is on screen: device, window, plots, frame, cursors (C)"} onClick={() => void shareLive()}>
        <Icon name="share" />
      </button>
      <span class="vh" role="status">
        {said.value}
      </span>
    </>
  );
}
