/** Evidence of an open recording. */
import type { ViewState } from "../../data/view-state";
import type { FigureSource } from "../../measure/server-figures";
import { titleOf } from "../../recordings/library-filter";
import type { RecordingInfo } from "../../recordings/types";
import type { App } from "../app-state";
import { EvidenceDialog } from "./evidence-dialog";
import { TEXT } from "../../texts/evidence-dialog";

interface Props {
  readonly app: App;
  readonly info: RecordingInfo;
  readonly viewState: ViewState;
  readonly source: FigureSource;
  readonly onClose: () => void;
}

export function RecordingEvidence({ app, info, viewState, source, onClose }: Props) {
  return (
    <EvidenceDialog
      app={app}
      title={titleOf(info)}
      viewState={viewState}
      source={source}
      wholeName={TEXT.whole}
      recordingOf={async () => info.id}
      onClose={onClose}
    />
  );
}
