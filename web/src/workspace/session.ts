/** What a page does with its workspace: arranging, undo, maximising. One for each view. */
import { type Signal, signal } from "@preact/signals";
import type { ViewState } from "../data/view-state";
import { perApp } from "../page/app-state";
import type { App } from "../page/context";
import "./view-parts";
import { WorkspaceHistory } from "./history";
import { type Layout, maximise } from "../data/layout";
import { applyWorkspace, withoutMoment, type WorkspaceView, workspaceOf } from "./parts";

/** Interval at which a change becomes a step of undo, ms. */
const LOOK_MS = 300;

export interface WorkspaceSession {
  readonly view: WorkspaceView;
  readonly history: WorkspaceHistory;
  /** Whether the panels are being arranged. */
  readonly arranging: Signal<boolean>;
  /** What could not be applied of the last workspace, in words. */
  readonly problems: Signal<readonly string[]>;
  /** Counts changes, for components that show whether something can be undone. */
  readonly steps: Signal<number>;
  /** Set the layout as a function of the present one: a step of undo. */
  readonly change: (next: (layout: Layout) => Layout) => void;
  /** As `change`, while something is dragged: a step once it stands still. */
  readonly adjust: (next: (layout: Layout) => Layout) => void;
  readonly undo: () => void;
  readonly redo: () => void;
  /** Set the view as a stored workspace says: a step of undo. Where in time the view is stays. */
  readonly open: (json: unknown) => void;
  /** Give a panel the whole page, or take it back. */
  readonly toggleMaximised: (id: string) => void;
}

const sessions = perApp(() => new WeakMap<ViewState, WorkspaceSession>());

export function sessionOf(app: App, viewState: ViewState, bounds?: WorkspaceView["bounds"]): WorkspaceSession {
  const found = sessions(app).get(viewState);
  if (found) return found;
  const session = newSession({ viewState, folded: app.folded, ...(bounds ? { bounds } : {}) });
  sessions(app).set(viewState, session);
  return session;
}

function newSession(view: WorkspaceView): WorkspaceSession {
  const steps = signal(0);
  const history = new WorkspaceHistory(
    () => workspaceOf(view, withoutMoment),
    (workspace) => void applyWorkspace(view, workspace, withoutMoment),
  );
  const { layout } = view.viewState;
  const adjust: WorkspaceSession["adjust"] = (next) => {
    layout.value = next(layout.peek());
    steps.value += 1;
  };
  const change: WorkspaceSession["change"] = (next) => {
    history.mark();
    adjust(next);
    history.mark();
  };
  const problems = signal<readonly string[]>([]);
  const open = (json: unknown): void => {
    history.mark();
    problems.value = applyWorkspace(view, json, withoutMoment);
    history.mark();
    steps.value += 1;
  };
  const go = (step: () => boolean) => (): void => {
    step();
    steps.value += 1;
  };
  return {
    view,
    history,
    arranging: signal(false),
    problems,
    open,
    steps,
    change,
    adjust,
    undo: go(() => history.undo()),
    redo: go(() => history.redo()),
    toggleMaximised: (id) => change((now) => maximise(now, now.maximised === id ? undefined : id)),
  };
}

/** Follow the changes of a view while it is on the page. */
export function followWorkspace({ history, steps }: WorkspaceSession): () => void {
  let could = false;
  const timer = setInterval(() => {
    history.look();
    if (history.canUndo !== could) steps.value += 1;
    could = history.canUndo;
  }, LOOK_MS);
  return () => clearInterval(timer);
}
