/** Evidence of Live: what is in memory becomes a recording, of which the file is made. */
import { useSignal } from "@preact/signals";
import type { FigureSource } from "../../measure/figure-source";
import { recordingsApi } from "../../recordings/api";
import type { HttpProblem } from "../../requests/http";
import type { LiveDialogProps } from "../../page/context";
import { EvidenceDialog, type EvidenceRange } from "./dialog";
import { TEXT } from "./texts";
import { TEXT as LIVE } from "../../texts/live";

/** Samples may be shown at their device's time, which is this far from the arrival of their bytes at most, s. */
const MARGIN_S = 1;

export function LiveEvidence({ app, onClose }: LiveDialogProps) {
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const source: FigureSource = {
    id: "",
    prefix: (device) => `${device}/`,
    sent: (id) => app.store.sent(id),
    changeOf: (id) => app.store.changeOf(id),
  };
  const save = async ({ t0, t1 }: EvidenceRange): Promise<string | undefined> => {
    const saved = await recordingsApi.saveMemory({
      devices: null,
      seconds: null,
      t0: t0 === null ? null : t0 - MARGIN_S,
      t1: t1 === null ? null : t1 + MARGIN_S,
      title: LIVE.partOfLive,
    });
    problem.value = saved.ok ? undefined : saved.problem;
    return saved.ok ? saved.value.id : undefined;
  };
  return (
    <EvidenceDialog
      app={app}
      title={TEXT.live}
      viewState={app.viewState}
      source={source}
      wholeName={TEXT.allInMemory}
      recordingOf={save}
      problem={problem.value}
      onClose={onClose}
    >
      <p class="dim">{TEXT.fromMemory}</p>
    </EvidenceDialog>
  );
}
