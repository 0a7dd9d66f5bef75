/** Evidence of an open recording. */
import type { RecordingDialogProps } from "../../pages/recordings/open-recording";
import { recordingTitle } from "../../recordings/library-filter";
import { EvidenceDialog } from "./dialog";
import { TEXT } from "./texts";

export function RecordingEvidence({ recording, onClose }: RecordingDialogProps) {
  const { app, replay } = recording;
  const { info } = replay.detail;
  return (
    <EvidenceDialog
      app={app}
      title={recordingTitle(info)}
      viewState={replay.viewState}
      source={replay.samples.source}
      wholeName={TEXT.whole}
      recordingOf={async () => info.id}
      onClose={onClose}
    />
  );
}
