/** An open recording on a page: its controller, and what is open over its plots. */
import { type Signal, signal } from "@preact/signals";
import type { FunctionComponent } from "preact";
import type { Deps, App } from "../../page/context";
import type { ReplayController } from "../../recordings/replay-controller";
import { type LinkedPlace, placeHref } from "../../page/permalink";
import { applyLinkText, linkTextOf } from "../../workspace/parts";
import { sessionOf, type WorkspaceSession } from "../../workspace/session";

declare module "../../page/context" {
  interface ExtensionDialog {
    readonly Recording?: FunctionComponent<RecordingDialogProps>;
  }
}

declare module "../../page/keys" {
  interface ExtensionPress {
    /** The one it was pressed over; undefined on Live. */
    readonly recording?: OpenRecording;
  }
}

export interface RecordingDialogProps {
  readonly recording: OpenRecording;
  readonly onClose: () => void;
}

export interface OpenRecording {
  readonly replay: ReplayController;
  readonly app: App;
  /** Context of its panels. */
  readonly deps: Deps;
  /** Position of a new marker, unix s, while its words are typed. */
  readonly placing: Signal<number | undefined>;
  /** The last action, in words. */
  readonly said: Signal<string>;
  /** Whether the settings as recorded are shown. */
  readonly showsSettings: Signal<boolean>;
}

/** @param before the same recording while less of it was decoded: its settings stay open, and what was said is finished */
export function openRecording(replay: ReplayController, app: App, before?: OpenRecording): OpenRecording {
  const { info, devices } = replay.detail;
  const packet: Deps["open"]["packet"] = (at) => {
    const name = devices.find(({ id }) => id === at.device)?.name ?? at.device;
    app.open.packet({ ...at, name, recording: info.id });
  };
  return {
    replay,
    app,
    deps: {
      ...replay.deps,
      open: { ...app.open, packet },
      eventSort: app.eventSort,
      recording: { id: replay.detail.info.id, rate: () => (replay.playing.value ? replay.speed.value : 0) },
    },
    placing: signal(undefined),
    said: before?.said ?? signal(""),
    showsSettings: before?.showsSettings ?? signal(false),
  };
}

const workspaceIn = (app: App, { viewState, bounds }: ReplayController): WorkspaceSession =>
  sessionOf(app, viewState, bounds);

/** The address of what is on screen. */
export function recordingHref(app: App, replay: ReplayController): string {
  const workspace = linkTextOf(workspaceIn(app, replay).view);
  return placeHref(replay.detail.info.id, { ...replay.place(), ...(workspace === undefined ? {} : { workspace }) });
}

/** Show the workspace of a link; without one the present workspace stays. */
export function takeWorkspace(app: App, replay: ReplayController, { workspace }: LinkedPlace): void {
  if (workspace === undefined) return;
  const session = workspaceIn(app, replay);
  session.problems.value = applyLinkText(session.view, workspace);
}
