/** The link to what is on screen on Live: a button and its key. */
import { signal } from "@preact/signals";
import type { ViewState } from "../data/view-state";
import { Icon } from "../ui/icons";
import { copyLiveLink } from "./live-address";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";

/** How long the button says that the link was copied, ms. */
const SAID_MS = 2500;
const said = signal("");

export async function shareLive(viewState: ViewState): Promise<void> {
  said.value = (await copyLiveLink(viewState)) ? COMMON.linkCopied : COMMON.copyBlocked;
  setTimeout(() => (said.value = ""), SAID_MS);
}

export function Share({ viewState }: { readonly viewState: ViewState }) {
  return (
    <>
      <button
        type="button"
        class={`btn icon desk flag share ${said.value ? "just-done" : ""}`}
        aria-label={COMMON.copyLink}
        title={said.value || TEXT.copyLinkToView}
        onClick={() => void shareLive(viewState)}
      >
        <Icon name="share" />
      </button>
      <span class="visually-hidden" role="status">
        {said.value}
      </span>
    </>
  );
}
