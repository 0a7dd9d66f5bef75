/**
 * A recording in Rerun's viewer, in a frame over the player: opened by one click, removed when closed. It opens the loop range if set,
 * else the whole recording; the frame's own address is a link that opens the same.
 */
import type { Signal } from "@preact/signals";
import type { ReplayController } from "../recordings/replay-controller";
import { Icon } from "../ui/icons";
import { shownRobot } from "../ui/server-place";
import { theme } from "../ui/theme";
import { viewerHref } from "./viewer-href";
import { ViewerPanel } from "./viewer-panel";
import { TEXT } from "../texts/viewers";
import "./rerun.css";

interface Props {
  /** The address shown in the frame; undefined while closed. */
  readonly shown: Signal<string | undefined>;
}

/** Opens the selected range of a recording. */
export function RerunButton({ replay, shown }: Props & { readonly replay: ReplayController }) {
  if (shownRobot() !== undefined) return null;
  const open = (): void => {
    const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
    shown.value = viewerHref(replay.detail.info.id, loop, theme.peek());
  };
  return (
    <button type="button" class="btn edge" title={TEXT.openInRerunHint} onClick={open}>
      <Icon name="cube" />
      {TEXT.openInRerun}
    </button>
  );
}

/** The frame, over everything else of the page. */
export function RerunPanel({ shown }: Props) {
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
