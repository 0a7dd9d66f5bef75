/** The Recordings page: the library, or an open recording. Loaded on first use. */
import type { App } from "../../page/context";
import { reopened, route, href } from "../../page/route";
import { LibraryPage } from "./library";
import { useSignal } from "@preact/signals";
import { useLayoutEffect } from "preact/hooks";
import { createViewState } from "../../data/view-state";
import { readPlace } from "../../page/permalink";
import { type Answer, detailOf } from "../../recordings/prefetch";
import { ReplayController } from "../../recordings/replay-controller";
import type { VisibleRange } from "../../recordings/visible-range";
import { isOpening } from "../../recordings/api";
import type { OpeningState, RecordingDetail } from "../../wire/recording-types";
import { Card } from "../../ui/controls/card";
import type { HttpProblem } from "../../requests/http";
import { TopBar } from "../top-bar";
import { showReplay } from "../test-hook";
import { OfflineBand } from "../empty-states";
import { PageOverlays } from "../overlays";
import { type OpenRecording, openRecording, takeWorkspace } from "./open-recording";
import { ReplayPage } from "./replay-page";
import { libraryOf } from "./library-store";
import { TEXT } from "../../texts/recordings";
import "./library.css";
import "./details.css";
import "./phone.css";
import "./replay.css";

export function RecordingsPage({ app }: { readonly app: App }) {
  const id = route.value.recording;
  return id === undefined ? <LibraryPage app={app} /> : <OpenPage key={id + reopened.value} id={id} app={app} />;
}

/** Polling interval of the progress, ms. */
const ASK_MS = 120;
/** Polling interval once part of it is on screen, ms. */
const MORE_MS = 400;

type State =
  | { readonly kind: "opening"; readonly state: OpeningState | undefined }
  | { readonly kind: "failed"; readonly problem: HttpProblem }
  | { readonly kind: "open"; readonly recording: OpenRecording; readonly times: number };

function OpenPage({ id, app }: { readonly id: string; readonly app: App }) {
  const now = useSignal<State>({ kind: "opening", state: undefined });
  // before the page is painted: prefetched data is on screen with the first frame
  // biome-ignore lint/correctness/useExhaustiveDependencies: the app never changes
  useLayoutEffect(() => {
    let recording: OpenRecording | undefined;
    let timer: ReturnType<typeof setTimeout> | undefined;
    let over = false;
    let times = 0;
    const opened = (detail: RecordingDetail, screen?: VisibleRange): void => {
      if (detail.progress < 1) timer = setTimeout(() => void ask(), MORE_MS);
      if (recording?.replay.grow(detail)) return;
      const place = readPlace(route.peek().query ?? "");
      const replay =
        recording?.replay.reopened(detail) ??
        new ReplayController(detail, place, createViewState(app.viewState), screen);
      if (!recording) takeWorkspace(app, replay, place);
      showReplay(replay);
      recording = openRecording(replay, app, recording);
      now.value = { kind: "open", recording, times: (times += 1) };
    };
    const ask = async (first?: Promise<Answer>): Promise<void> => {
      const { outcome, screen } = first ? await first : { outcome: await detailOf(id), screen: undefined };
      if (over) return screen?.dispose();
      if (!outcome.ok && outcome.problem.status === 0 && recording) timer = setTimeout(() => void ask(), 2000);
      else if (!outcome.ok) {
        now.value = { kind: "failed", problem: outcome.problem };
        // a server that is away comes back; a file that cannot be opened stays so
        if (outcome.problem.status === 0) timer = setTimeout(() => void ask(), 2000);
      } else if (isOpening(outcome.value)) {
        now.value = { kind: "opening", state: outcome.value };
        timer = setTimeout(() => void ask(), ASK_MS);
      } else opened(outcome.value, screen);
    };
    const { all, prefetch } = libraryOf(app);
    void ask(
      prefetch.take(
        id,
        all.peek()?.find((one) => one.id === id),
      ),
    );
    return () => {
      over = true;
      clearTimeout(timer);
      recording?.replay.dispose();
      showReplay(undefined);
    };
  }, [id]);
  const state = now.value;
  if (state.kind === "open") return <ReplayPage key={state.times} recording={state.recording} />;
  return (
    <div class={`app plain ${app.store.connection.value === "closed" ? "offline" : ""}`}>
      <TopBar app={app} />
      {app.store.connection.value === "closed" && <OfflineBand app={app} />}
      <main class="centre whole-centre">
        <h1 class="visually-hidden">{TEXT.recordingId(id)}</h1>
        {state.kind === "failed" ? <Failed problem={state.problem} /> : <Opening id={id} state={state.state} />}
      </main>
      <PageOverlays app={app} />
    </div>
  );
}

function Opening({ id, state }: { readonly id: string; readonly state: OpeningState | undefined }) {
  const share = state?.progress ?? 0;
  return (
    <Card
      class="opening"
      title={<span class="ellipsis">{TEXT.openingId(id)}</span>}
      message={state?.message ?? TEXT.checkingCache}
    >
      <progress value={share} max={1} aria-label={TEXT.openedShare(Math.round(100 * share))} />
      <p class="num">
        {Math.round(100 * share)}
        <span class="unit">%</span>
      </p>
    </Card>
  );
}

function Failed({ problem }: { readonly problem: HttpProblem }) {
  return (
    <Card title={TEXT.cannotBeOpened} dot="bad" message={problem.message} hint={problem.hint}>
      <div class="row">
        <a class="btn main" href={href("recordings")}>
          {TEXT.toLibrary}
        </a>
      </div>
    </Card>
  );
}
