/** Sharing a recording: a link to the view, an export, the whole file, or a device that plays it. */
import { useSignal } from "@preact/signals";
import { hasCursors } from "../../data/view-state";
import { length, recordingTitle } from "../../recordings/library-filter";
import type { ReplayController } from "../../recordings/replay-controller";
import { Slot } from "../../extension/extension";
import { recordingsApi } from "../../recordings/api";
import type { PlayRequest } from "../../wire/recording-types";
import { Button } from "../../ui/controls/button";
import { copyText } from "../../ui/dom/copy";
import { Icon } from "../../ui/controls/icons";
import { run, select } from "../../page/app-state";
import type { App } from "../../page/context";
import { go } from "../../page/route";
import { showSaved } from "../record-button";
import { type OpenRecording, recordingHref } from "./open-recording";
import { exportingOf, type ExportRange } from "../../recordings/exporting";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

declare module "../../extension/extension" {
  interface Slots {
    /** Actions of an open recording, beside its name. */
    readonly recordingActions: { readonly recording: OpenRecording };
  }
}

/** How long the last action is shown, ms. */
const SAID_MS = 2500;

export async function copyLink({ replay, app, said }: OpenRecording): Promise<void> {
  const href = recordingHref(app, replay);
  said.value = (await copyText(new URL(href, location.href).href)) ? COMMON.linkCopied : COMMON.copyBlocked;
  history.replaceState(null, "", href);
  setTimeout(() => (said.value = ""), SAID_MS);
}

export async function playAsDevice(app: App, recording: string, how: PlayRequest): Promise<void> {
  const [device] = (await run(app, recordingsApi.play(recording, how))) ?? [];
  if (!device) return;
  select(app, device.id);
  go("live");
}

/** The selected ranges of a recording, for export. */
function rangesOf(replay: ReplayController): readonly ExportRange[] {
  const { first, last } = replay.bounds;
  const { end, span } = replay.viewState.view.peek();
  const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
  const seen: ExportRange = { name: TEXT.inView, t0: Math.max(first, end - span), t1: Math.min(last, end) };
  return [...(loop ? [{ name: TEXT.loopRange, t0: loop[0], t1: loop[1] }] : []), ...(seen.t1 > seen.t0 ? [seen] : [])];
}

/** Makes a recording of the range between the cursors, else of the one in view, and offers to open it. */
async function keepRange({ replay, app }: OpenRecording): Promise<void> {
  const { info } = replay.detail;
  const { first, last } = replay.bounds;
  const { cursor, measure, view, actions } = replay.viewState;
  const { end, span, timeBase: base } = view.peek();
  const [a, b] = [cursor.peek()?.kind === "pinned" ? actions.cursorTime() : undefined, measure.peek()];
  const [from, to] = a !== undefined && b !== undefined ? [Math.min(a, b), Math.max(a, b)] : [end - span, end];
  const [t0, t1] = [Math.max(first, from), Math.min(last, to)];
  const title = TEXT.rangeOf(recordingTitle(info), length(t0 - first, 1), length(t1 - first, 1));
  const kept = await run(app, recordingsApi.keep(info.id, { t0, t1, base, title }));
  if (kept) showSaved(app, { id: kept.id, title: recordingTitle(kept) });
}

/** The actions, beside the recording's name. */
export function HandOn({ recording }: { readonly recording: OpenRecording }) {
  const { replay, app } = recording;
  const { detail } = replay;
  const { info } = detail;
  const keeping = useSignal(false);
  const play = (): void => {
    const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
    const [t0, t1] = [loop?.[0] ?? null, loop?.[1] ?? null];
    void playAsDevice(app, info.id, { speed: replay.speed.peek(), loop: loop !== undefined, t0, t1 });
  };
  return (
    <div class="hand-over flex-wrap" role="group" aria-label={TEXT.share}>
      <Button
        look="main"
        icon="share"
        words={COMMON.copyLink}
        title={TEXT.copyLinkToView}
        onClick={() => void copyLink(recording)}
      />
      <Button
        changes
        look="edge"
        icon="upload"
        words={TEXT.export}
        onClick={() =>
          (exportingOf(app).value = {
            info,
            detail,
            ranges: rangesOf(replay),
            first: replay.bounds.first,
            base: replay.viewState.view.peek().timeBase,
          })
        }
      />
      <Button
        changes
        look="edge"
        icon="library"
        words={hasCursors(replay.viewState) ? TEXT.keepBetweenCursors : TEXT.keepRange}
        title={TEXT.keepRangeHint}
        disabled={keeping.value}
        onClick={() => {
          keeping.value = true;
          void keepRange(recording).finally(() => (keeping.value = false));
        }}
      />
      <Slot name="recordingActions" with={{ recording }} />
      <a class="btn edge" href={recordingsApi.downloadUrl(info.id)} download="" title={TEXT.downloadHint}>
        <Icon name="download" />
        {COMMON.download}
      </a>
      <Button changes look="edge" icon="wave" words={TEXT.asDevice} title={TEXT.playLiveHint} onClick={play} />
    </div>
  );
}
