/**
 * A recording in Rerun's viewer, in a frame over the player: opened by one click, removed when closed. It opens the loop range if set,
 * else the whole recording; the frame's own address is a link that opens the same.
 */
import { signal } from "@preact/signals";
import { madeFor } from "../../page/app-state";
import type { OpenRecording } from "../../pages/recordings/open-recording";
import { Button } from "../../ui/controls/button";
import { shownRobot } from "../../requests/server-place";
import { theme } from "../../ui/dom/theme";
import { viewerHref } from "./viewer-href";
import { ViewerPanel } from "../../views/viewer-panel";
import { TEXT } from "./texts";
import "./rerun.css";

interface Props {
  readonly recording: OpenRecording;
}

/** The address shown in the frame; undefined while closed. */
const addressOf = madeFor((_: OpenRecording) => signal<string | undefined>(undefined));

/** Opens the selected range of a recording. */
export function RerunButton({ recording }: Props) {
  const { replay } = recording;
  const shown = addressOf(recording);
  if (shownRobot() !== undefined) return null;
  const open = (): void => {
    const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
    shown.value = viewerHref(replay.detail.info.id, loop, theme.peek());
  };
  return <Button look="edge" icon="cube" words={TEXT.openInRerun} title={TEXT.openInRerunHint} onClick={open} />;
}

/** The frame, over everything else of the page. */
export function RerunPanel({ recording }: Props) {
  const shown = addressOf(recording);
  const address = shown.value;
  if (address === undefined) return null;
  return (
    <ViewerPanel
      class="rerun"
      label={TEXT.rerunViewer}
      heading={TEXT.rerun}
      closeHint={TEXT.closeRerun}
      onClose={() => (shown.value = undefined)}
      address={address}
    >
      <iframe src={address} title={TEXT.rerunViewer} allow="fullscreen" />
    </ViewerPanel>
  );
}
