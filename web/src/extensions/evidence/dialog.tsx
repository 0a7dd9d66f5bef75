/** Asks what evidence is to show, and makes it as a job of the server. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import type { ViewState } from "../../data/view-state";
import { type FigureSource, wantedOf } from "../../measure/figure-source";
import { recordingsApi } from "../../recordings/api";
import { takeExport } from "../../recordings/exporting";
import { Button } from "../../ui/controls/button";
import { Segmented } from "../../ui/controls/choices";
import { Dialog } from "../../ui/controls/dialog";
import type { HttpProblem } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import type { App, LiveDialogProps } from "../../page/context";
import { Jobs } from "../../pages/recordings/export-jobs";
import { TEXT } from "./texts";
import { TEXT as LIVE } from "../../texts/live";
import type { RecordingDialogProps } from "../../pages/recordings/open-recording";
import { recordingTitle } from "../../recordings/library-filter";
import { byUnit, visible } from "../../plots/visible-plots";
import { labelOf } from "../../signals/plot-selection";
import type { EvidencePlot, EvidenceSeries } from "../../wire/routes";
import "../../pages/recordings/export.css";
import "./dialog.css";

type Part = "view" | "cursors" | "whole";

/** A part of what is on screen; null: from the beginning, or to the end. */
export interface EvidenceRange {
  readonly t0: number | null;
  readonly t1: number | null;
}

interface Props {
  readonly app: App;
  readonly title: string;
  readonly viewState: ViewState;
  readonly source: FigureSource;
  readonly wholeName: string;
  /** The recording with that range; undefined when it failed, and a problem was shown. */
  readonly recordingOf: (range: EvidenceRange) => Promise<string | undefined>;
  readonly problem?: HttpProblem | undefined;
  readonly children?: ComponentChildren;
  readonly onClose: () => void;
}

export function EvidenceDialog(props: Props) {
  const { app, title, viewState, source, wholeName, recordingOf, problem, children, onClose } = props;
  const { view, cursor, measure, actions } = viewState;
  const part = useSignal<Part>("view");
  const leavesOut = useSignal(false);
  const busy = useSignal(false);
  const refused = useSignal<HttpProblem | undefined>(undefined);
  const made = useSignal<string | undefined>(undefined);
  // live, the view goes on while the dialog is open: what was on screen when it was opened is meant
  const now = useSignal(takeView()).value;
  function takeView() {
    const t1 = actions.rightEdge();
    const a = cursor.peek()?.kind === "pinned" ? actions.cursorTime() : undefined;
    return {
      view: { t0: t1 - view.peek().span, t1 },
      a: a ?? null,
      b: (a === undefined ? undefined : measure.peek()) ?? null,
      base: view.peek().timeBase,
      plots: evidencePlots(viewState, source),
    };
  }
  const { a, b, plots } = now;
  const range: EvidenceRange =
    part.value === "view"
      ? now.view
      : part.value === "cursors" && a !== null && b !== null
        ? { t0: Math.min(a, b), t1: Math.max(a, b) }
        : { t0: null, t1: null };
  const make = async (): Promise<void> => {
    busy.value = true;
    const recording = await recordingOf(range);
    if (recording !== undefined) {
      const outcome = await recordingsApi.evidence(recording, {
        ...range,
        base: now.base,
        plots: plots.plots,
        cursor_a: a,
        cursor_b: b,
        with_position: !leavesOut.value,
      });
      refused.value = outcome.ok ? undefined : outcome.problem;
      if (outcome.ok) takeExport(app)(outcome.value);
      made.value = recording;
    }
    busy.value = false;
  };
  const shown = problem ?? refused.value;
  const names = { view: TEXT.inView, cursors: TEXT.betweenCursors, whole: wholeName };
  const parts: readonly Part[] = b === null ? ["view", "whole"] : ["view", "cursors", "whole"];
  return (
    <Dialog title={TEXT.title(title)} onClose={onClose}>
      <div class="export evidence">
        <Segmented
          label={TEXT.part}
          class="full-width"
          value={part.value}
          options={parts.map((one) => [one, names[one]])}
          onChoose={(one) => (part.value = one)}
        />
        <p class="dim">{TEXT.what}</p>
        {children}
        <label class="leave-out text-sm">
          <input
            type="checkbox"
            checked={leavesOut.value}
            onChange={(event) => (leavesOut.value = event.currentTarget.checked)}
          />
          <b>{TEXT.leaveOut}</b>
          <small>{TEXT.leaveOutHint}</small>
        </label>
        {plots.without.length > 0 && <p class="dim">{TEXT.without(plots.without.join(", "))}</p>}
        {shown && <ProblemNote problem={shown} />}
        <Button
          changes
          look="main start-export"
          icon="paper"
          words={busy.value ? TEXT.making : TEXT.make}
          disabled={busy.value}
          onClick={() => void make()}
        />
        {(made.value ?? source.id) !== "" && <Jobs app={app} recording={made.value ?? source.id} />}
      </div>
    </Dialog>
  );
}

/** Samples may be shown at their device's time, which is this far from the arrival of their bytes at most, s. */
const MARGIN_S = 1;

export function LiveEvidence({ app, onClose }: LiveDialogProps) {
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const source: FigureSource = {
    id: "",
    prefix: (info) => `${info.device}/${app.store.isShared(info) ? `${info.message}/` : ""}`,
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

interface EvidencePlots {
  readonly plots: EvidencePlot[];
  /** Labels of curves that the server cannot compute. */
  readonly without: readonly string[];
}

export function evidencePlots({ actions, hiddenSeries, yAxes }: ViewState, source: FigureSource): EvidencePlots {
  const without: string[] = [];
  const plots = visible(actions.plots(), hiddenSeries.peek())
    .flatMap(byUnit)
    .flatMap((plot): EvidencePlot[] => {
      const series = plot.series.flatMap((one): EvidenceSeries[] => {
        const wanted = wantedOf(one, source);
        if (wanted === undefined) {
          without.push(`${plot.title} ${labelOf(one)}`);
          return [];
        }
        const { word: signal, part, factor, offset, period } = wanted;
        const { colour, dash, decimals } = one;
        return [{ signal, part, factor, offset, period, label: labelOf(one), colour, dash: [...dash], decimals }];
      });
      if (series.length === 0) return [];
      const axis = yAxes.peek().get(plot.key);
      const [low, high] = axis?.range ?? [null, null];
      const title = plot.frame === "" ? plot.title : `${plot.title} · ${plot.frame}`;
      return [{ title, unit: plot.unit, series, low, high, log: axis?.isLog === true }];
    });
  return { plots, without };
}
