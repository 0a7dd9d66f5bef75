/** Saves or exports what has just happened: the bytes of live devices that the server has in memory. */
import { useSignal } from "@preact/signals";
import { Slot } from "../extension/extension";
import { recordingsApi } from "../recordings/api";
import { bytes, length } from "../recordings/library-filter";
import type { SavedMemory } from "../wire/recording-types";
import { Button } from "../ui/controls/button";
import { Segmented } from "../ui/controls/choices";
import { Dialog } from "../ui/controls/dialog";
import { clock } from "../ui/format/format";
import type { HttpProblem } from "../requests/http";
import { ProblemNote } from "../requests/problem-note";
import { useAnswer } from "../requests/use-answer";
import type { App } from "../page/context";
import { showSaved } from "./record-button";
import { exportingOf } from "../recordings/exporting";
import { TEXT } from "../texts/live";

declare module "../extension/extension" {
  interface Slots {
    /** What can be made of the bytes in memory besides a recording. */
    readonly memoryActions: { readonly app: App; readonly disabled: boolean };
  }
}

/** Samples may be shown at their device's time, which is this far from the arrival of their bytes at most, s. */
const MARGIN_S = 1;
const LAST_S = 60;

type Part = "view" | "minute" | "all";

interface Props {
  readonly app: App;
  readonly onClose: () => void;
}

export function MemoryDialog({ app, onClose }: Props) {
  const { answer: held, problem: unread } = useAnswer("memory", () => recordingsApi.memory());
  const part = useSignal<Part>("view");
  const busy = useSignal(false);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const { view, actions } = app.viewState;
  // the view goes on while the dialog is open: what was in view when it was opened is meant
  const t1 = useSignal(actions.rightEdge()).value;
  const t0 = useSignal(t1 - view.peek().span).value;
  const shown = problem.value ?? unread;
  const range = {
    view: { t0: t0 - MARGIN_S, t1: t1 + MARGIN_S },
    minute: { t0: t1 - LAST_S, t1: null },
    all: { t0: null, t1: null },
  }[part.value];
  const save = async (): Promise<SavedMemory | undefined> => {
    const outcome = await recordingsApi.saveMemory({ devices: null, seconds: null, title: TEXT.partOfLive, ...range });
    problem.value = outcome.ok ? undefined : outcome.problem;
    return outcome.ok ? outcome.value : undefined;
  };
  const whileBusy = async (act: () => Promise<void>): Promise<void> => {
    busy.value = true;
    await act();
    busy.value = false;
  };
  const keep = async (): Promise<void> => {
    const saved = await save();
    if (!saved) return;
    showSaved(app, { id: saved.id, title: TEXT.partOfLive });
    onClose();
  };
  const exportIt = async (): Promise<void> => {
    const saved = await save();
    const list = saved && (await recordingsApi.list());
    if (!saved || !list) return;
    const info = list.ok ? list.value.find(({ id }) => id === saved.id) : undefined;
    if (!list.ok || !info) {
      if (!list.ok) problem.value = list.problem;
      return;
    }
    const shown = { name: TEXT.inView, t0, t1 };
    const inView = part.value === "view";
    exportingOf(app).value = {
      info,
      detail: undefined,
      ranges: inView ? [shown] : [],
      first: saved.t0,
      base: view.peek().timeBase,
      ...(inView ? { chosen: shown } : {}),
    };
    onClose();
  };
  const links = held ?? [];
  const begins = Math.min(...links.map((one) => one.t0));
  const gone = links.length > 0 && part.value === "view" && links.every((one) => one.t0 > t1 || one.t1 < t0);
  const late = !gone && part.value === "view" && links.length > 0 && begins > t0 + MARGIN_S;
  return (
    <Dialog title={TEXT.saveFromMemory} onClose={onClose}>
      <div class="from-memory-dialog stacked">
        <Segmented
          label={TEXT.partToSave}
          class="full-width"
          value={part.value}
          options={[
            ["view", TEXT.inView],
            ["minute", TEXT.lastMinute],
            ["all", TEXT.allInMemory],
          ]}
          onChoose={(one) => (part.value = one)}
        />
        {held && links.length === 0 && <p role="status">{TEXT.memoryEmpty}</p>}
        {gone && <p role="status">{TEXT.memoryGone}</p>}
        {late && <p role="status">{TEXT.memoryBeginsLater(clock(begins))}</p>}
        <ul class="dim" aria-busy={held === undefined}>
          {links.map((one) => {
            const size = bytes(one.size);
            const name = app.store.devices.value.find(({ id }) => id === one.device)?.name ?? one.device;
            return <li key={one.device}>{TEXT.memoryReaches(name, length(one.t1 - one.t0), size.value, size.unit)}</li>;
          })}
        </ul>
        <p class="dim">{TEXT.memoryHint}</p>
        {shown && <ProblemNote problem={shown} />}
        <div class="ends">
          <Slot name="memoryActions" with={{ app, disabled: busy.value || links.length === 0 }} />
          <Button
            changes
            look="edge"
            icon="download"
            words={TEXT.exportFromMemory}
            disabled={busy.value || links.length === 0 || gone}
            onClick={() => void whileBusy(exportIt)}
          />
          <Button
            changes
            look="main"
            words={busy.value ? TEXT.savingFromMemory : TEXT.saveAsRecording}
            disabled={busy.value || links.length === 0 || gone}
            onClick={() => void whileBusy(keep)}
          />
        </div>
      </div>
    </Dialog>
  );
}
