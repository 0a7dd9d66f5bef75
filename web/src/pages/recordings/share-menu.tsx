/** Handing a recording on: a link to what is on screen, an export of it, the whole file, or a device that plays it. */
import { signal } from "@preact/signals";
import { view } from "../../data/view-state";
import { placeHref } from "../../recordings/permalink";
import type { Replay } from "../../recordings/replay-controller";
import { server } from "../../recordings/api";
import { copyText } from "../../ui/copy";
import { Icon } from "../../ui/icons";
import { run, select } from "../app-state";
import { go } from "../route";
import { RerunButton } from "../../views/rerun";
import { exporting, type Range } from "./export-dialog";

/** What was done last, in words. */
export const said = signal("");
const SAID_MS = 2500;

export async function copyLink(replay: Replay): Promise<void> {
  const link = new URL(placeHref(replay.detail.info.id, replay.place()), location.href).href;
  said.value = (await copyText(link)) ? "Link copied" : "The browser does not let the page copy: the address above is the link";
  history.replaceState(null, "", placeHref(replay.detail.info.id, replay.place()));
  setTimeout(() => (said.value = ""), SAID_MS);
}

/** What is chosen of a recording, to be exported. */
function rangesOf(replay: Replay): readonly Range[] {
  const { first, last } = replay.bounds;
  const { end, span } = view.peek();
  const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
  const seen: Range = { name: "In view", t0: Math.max(first, end - span), t1: Math.min(last, end) };
  return [...(loop ? [{ name: "Loop range", t0: loop[0], t1: loop[1] }] : []), ...(seen.t1 > seen.t0 ? [seen] : [])];
}

/** The actions, beside the recording's name. */
export function HandOn({ replay }: { readonly replay: Replay }) {
  const { detail } = replay;
  const { info } = detail;
  const play = async (): Promise<void> => {
    const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
    const devices = await run(server.play(info.id, { speed: replay.speed.peek(), loop: loop !== undefined, t0: loop?.[0] ?? null, t1: loop?.[1] ?? null }));
    const [device] = devices ?? [];
    if (!device) return;
    select(device.id);
    go("live");
  };
  return (
    <div class="handon" role="group" aria-label="Hand on">
      <button type="button" class="btn main" title="Copy the link to what is on screen: recording, range, cursor, plots (C)" onClick={() => void copyLink(replay)}>
        <Icon name="share" />
        Copy link
      </button>
      <button type="button" class="btn edge" onClick={() => (exporting.value = { info, detail, ranges: rangesOf(replay), first: replay.bounds.first, base: view.peek().timeBase })}>
        <Icon name="upload" />
        Export…
      </button>
      <RerunButton replay={replay} />
      <a class="btn edge" href={server.downloadUrl(info.id)} download="" title="One file with everything in it; another imuscope opens it">
        <Icon name="download" />
        Download
      </a>
      <button type="button" class="btn edge" title="Play it as a live device that everybody sees" onClick={() => void play()}>
        <Icon name="wave" />
        As device
      </button>
    </div>
  );
}
