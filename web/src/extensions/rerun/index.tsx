/** The Rerun viewer: of live data in the frame of viewers, of recordings over the player. */
import { registerExtension } from "../../extension/extension";
import { theme } from "../../ui/dom/theme";
import { Frame } from "../../views/frame";
import { liveHref, viewerHref } from "./viewer-href";
import { TEXT } from "./texts";
import { signal } from "@preact/signals";
import { madeFor } from "../../page/app-state";
import type { OpenRecording } from "../../pages/recordings/open-recording";
import { Button } from "../../ui/controls/button";
import { shownRobot } from "../../requests/server-place";
import { ViewerPanel } from "../../views/viewer-panel";
import "./rerun.css";

/*
 * A recording in Rerun's viewer, in a frame over the player: opened by one click, removed when closed. It opens the loop range if set,
 * else the whole recording; the frame's own address is a link that opens the same.
 */

interface Props {
  readonly recording: OpenRecording;
}

/** The address shown in the frame; undefined while closed. */
const addressOf = madeFor((_: OpenRecording) => signal<string | undefined>(undefined));

/** Opens the selected range of a recording. */
function RerunButton({ recording }: Props) {
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
function RerunPanel({ recording }: Props) {
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

const address = (device: string | undefined): string => liveHref(device, theme.value);

function Live({ device }: { readonly device: string | undefined }) {
  return <Frame key={address(device)} address={address(device)} title={TEXT.rerunViewer} />;
}

registerExtension({
  name: "rerun",
  viewers: [
    {
      id: "rerun",
      order: 20,
      icon: "wave",
      title: TEXT.rerun,
      choice: TEXT.rerun,
      choiceHint: TEXT.rerunHint,
      object: TEXT.rerun,
      close: TEXT.closeRerun,
      allHint: TEXT.allDevices,
      address,
      Live,
    },
  ],
  views: [
    { slot: "recordingActions", order: 20, View: RerunButton },
    { slot: "recordingViews", order: 10, View: RerunButton },
    { slot: "recordingOverlays", order: 10, View: RerunPanel },
  ],
});
