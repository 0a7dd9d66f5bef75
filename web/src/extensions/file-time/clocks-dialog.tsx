/** Dialogs that a figure of loss, gap or jitter leads to: the clocks of a stream, or of the recording in the player. */
import type { LiveDialogProps } from "../../page/context";
import type { RecordingDialogProps } from "../../pages/recordings/open-recording";
import { Dialog } from "../../ui/controls/dialog";
import { ClocksPanel } from "./panel";
import { StreamPanel } from "./stream";
import { TEXT } from "./texts";

export function StreamDialog({ app, onClose }: LiveDialogProps) {
  return (
    <Dialog title={TEXT.stream} wide onClose={onClose}>
      <StreamPanel deps={app} onJump={onClose} />
    </Dialog>
  );
}

export function FileDialog({ recording: { deps }, onClose }: RecordingDialogProps) {
  const jump: NonNullable<typeof deps.jump> = (to) => {
    onClose();
    deps.jump?.(to);
  };
  return (
    <Dialog title={TEXT.title} wide onClose={onClose}>
      <ClocksPanel deps={{ ...deps, jump }} />
    </Dialog>
  );
}
