/** The dialog of the table that is open. */
import type { RecordingDialogProps } from "../../pages/recordings/open-recording";
import type { FileTime } from "../../wire/routes";
import { ReadingDialog } from "./reading-dialog";
import { reopen } from "./reopen";

export function RecordingReading({ recording, onClose }: RecordingDialogProps) {
  const { info } = recording.replay.detail;
  const state = recording.app.subject.value as Pick<FileTime, "reading" | "is_chosen"> | undefined;
  if (state === undefined) return null;
  const onChosen = (): void => {
    onClose();
    reopen(info.id);
  };
  return <ReadingDialog recording={info.id} title={info.file} state={state} onClose={onClose} onChosen={onChosen} />;
}
