/** The link to what is on screen on Live: a button and its key. */
import { signal } from "@preact/signals";
import { IconButton } from "../ui/controls/icon-button";
import { perApp } from "../page/app-state";
import type { App } from "../page/context";
import { copyLiveLink } from "./live-address";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";

/** How long the button says that the link was copied, ms. */
const SAID_MS = 2500;
/** Result of the last copy, in words. */
const saidOf = perApp(() => signal(""));

export async function shareLive(app: App): Promise<void> {
  const said = saidOf(app);
  said.value = (await copyLiveLink(app)) ? COMMON.linkCopied : COMMON.copyBlocked;
  setTimeout(() => (said.value = ""), SAID_MS);
}

export function Share({ app }: { readonly app: App }) {
  const said = saidOf(app);
  return (
    <>
      <IconButton
        class={`desk flag share ${said.value ? "just-done" : ""}`}
        icon="share"
        label={COMMON.copyLink}
        word={TEXT.linkWord}
        title={said.value || TEXT.copyLinkToView}
        onClick={() => void shareLive(app)}
      />
      <span class="visually-hidden" role="status">
        {said.value}
      </span>
    </>
  );
}
