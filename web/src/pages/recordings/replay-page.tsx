/** An open recording: the panels of Live over its samples, with the playback controls under the plots. */
import { useEffect } from "preact/hooks";
import { onFrame } from "../../data/render-loop";
import { fromExtensions, Slot } from "../../extension/extension";
import { placesOf } from "../../plots/markers";
import { mountStack, type StackDeps } from "../../plots/plot-stack";
import type { UnderPlots } from "../../plots/under-plots";
import { PLOTS_TILE } from "../../data/plot-order";
import { readPlace } from "../../page/permalink";
import { bytes, dateWords, length, recordingTitle } from "../../recordings/library-filter";
import type { App } from "../../page/context";
import { distinctName } from "../../wire/device-name";
import type { DeviceInfo } from "../../wire/types";
import type { ReplayController } from "../../recordings/replay-controller";
import { Band } from "../../ui/controls/band";
import type { Panel } from "../../ui/dom/dom";
import { Select } from "../../ui/controls/choices";
import { IconButton } from "../../ui/controls/icon-button";
import { Icon } from "../../ui/controls/icons";
import { Message } from "../../ui/controls/message";
import { PanelHost } from "../../panels/panel-host";
import { ArrangeTools } from "../../workspace/arrange";
import { LateSignalsPanel, LateYAxisDialog } from "../dialogs";
import { MainColumn } from "../../workspace/main-column";
import { sideWidthOf } from "../../workspace/side-width";
import { useWorkspace } from "../../workspace/use-workspace";
import { RecordingViewer, RecordingViews } from "../../views/viewers";
import { TopBar } from "../top-bar";
import { SideColumn } from "../side-panels";
import { keepAddress } from "../keep-address";
import { href, parse, route } from "../../page/route";
import { RowsDialog } from "../rows";
import { OfflineBand, ProblemBand } from "../empty-states";
import { listenForKeys } from "./keys";
import { type OpenRecording, recordingHref, takeWorkspace } from "./open-recording";
import { Markers } from "./markers";
import { mountOverview } from "./overview-strip";
import { PageOverlays } from "../overlays";
import { HandOn } from "./share-menu";
import { SettingsDialog, SettingsLine } from "./settings";
import { Transport } from "./transport";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

declare module "../../extension/extension" {
  interface Slots {
    /** On a phone, the line over an open recording that opens other views of it. */
    readonly recordingViews: { readonly recording: OpenRecording };
    /** Over everything else of an open recording. */
    readonly recordingOverlays: { readonly recording: OpenRecording };
  }
}

export function ReplayPage({ recording }: { readonly recording: OpenRecording }) {
  const { replay, app } = recording;
  const { info } = replay.detail;
  const { folded, overlay } = app;
  const root = useWorkspace(app, replay.viewState, replay.bounds);
  // biome-ignore lint/correctness/useExhaustiveDependencies: another recording has another key, and mounts another page
  useEffect(() => {
    document.title = `${recordingTitle(info)} · imuscope`;
    const stops = [
      onFrame((now) => replay.tick(now)),
      listenForKeys(recording, () => root.current),
      followAddress(app, replay),
    ];
    return () => stops.forEach((stop) => stop());
  }, []);
  const dialog = fromExtensions("dialogs").find((one) => one.overlay === overlay.value);
  const offline = app.store.connection.value === "closed" || app.store.silentSince.value !== undefined;
  return (
    <div
      ref={root}
      class={`app replay ${offline ? "offline" : ""} ${folded.value ? "folded" : ""}`}
      style={sideWidthOf(replay.viewState)}
    >
      <a class="btn edge skip" href="#plots">
        {COMMON.skipToThePlots}
      </a>
      <TopBar app={app} deps={recording.deps} />
      {offline && <OfflineBand app={app} />}
      <About recording={recording} />
      <main class="centre">
        <h1 class="visually-hidden">{recordingTitle(info)}</h1>
        <PhoneHead recording={recording} />
        <ProblemBand app={app} />
        <Trouble replay={replay} />
        <RecordingViews app={app}>
          <Slot name="recordingViews" with={{ recording }} />
        </RecordingViews>
        <RecordingViewer app={app} replay={replay} />
        <Panels key={replay.viewState.device.value} recording={recording} />
        <Transport recording={recording} />
        <PanelHost class="overview" label={TEXT.wholeRecording} mount={(host) => mountOverview(host, replay)} />
      </main>
      <SideColumn app={app} deps={recording.deps} />
      {dialog?.Recording && <dialog.Recording recording={recording} onClose={() => (overlay.value = undefined)} />}
      {app.showsSignals.value && (
        <LateSignalsPanel
          deps={recording.deps}
          tick={app.tick}
          isLive={false}
          onClose={() => (app.showsSignals.value = false)}
        />
      )}
      <ArrangeTools app={app} deps={recording.deps} />
      <RowsDialog app={app} deps={recording.deps} />
      <Slot name="recordingOverlays" with={{ recording }} />
      <SettingsDialog recording={recording} />
      <PageOverlays app={app} />
    </div>
  );
}

/** The instruments and the plots, as on Live: the plots draw the window, everything else reads at the cursor. */
function Panels({ recording: { replay, app, deps } }: { readonly recording: OpenRecording }) {
  return (
    <MainColumn
      app={app}
      deps={deps}
      mountPlots={(host, tile) => mountPlots(host, replay, { open: deps.open, ...tile })}
      under={
        <>
          <Slot name="underPlots" with={underPlots(replay)} />
          {replay.viewState.yAxisForm.value && <LateYAxisDialog viewState={replay.viewState} />}
        </>
      }
    />
  );
}

function underPlots(replay: ReplayController): UnderPlots {
  const device = (): string => replay.viewState.view.peek().device ?? "";
  return {
    viewState: replay.viewState,
    samples: replay.samples,
    source: () => replay.detail.info.id,
    places(kind) {
      if (kind === "marker") return replay.markers.peek().map(({ time }) => time);
      if (kind === "gap") return replay.drawn.losses(device()).map(({ t0 }) => t0);
      return placesOf(replay.detail.events, kind, device());
    },
    halt: () => (replay.playing.value = false),
  };
}

function mountPlots(host: HTMLElement, replay: ReplayController, deps: Partial<StackDeps>): Panel {
  const stack = mountStack(host, {
    store: replay.drawn,
    viewState: replay.viewState,
    reads: (channel, t) => replay.reads(channel, t),
    bounds: () => replay.bounds,
    markers: () => replay.markers.peek(),
    ...deps,
  });
  const resized = new ResizeObserver(() => {
    const style = getComputedStyle(host);
    const of = (name: string): number => parseFloat(style.getPropertyValue(name)) || 0;
    replay.pixels = Math.max(200, host.clientWidth - of("--gutter-w") - of("--tail-w"));
  });
  if (deps.tile === PLOTS_TILE) resized.observe(host);
  return {
    update: (now) => stack.update(now),
    dispose() {
      resized.disconnect();
      stack.dispose();
    },
  };
}

/** Keep the address up to date while paused; a link opened over it moves there. */
function followAddress(app: App, replay: ReplayController): () => void {
  const { id } = replay.detail.info;
  let ours = location.hash;
  const next = (): string | undefined =>
    replay.playing.peek() || parse(location.hash)?.recording !== id ? undefined : recordingHref(app, replay);
  const stop = keepAddress(next, (hash) => {
    ours = hash;
  });
  const moved = route.subscribe(({ recording, query }) => {
    if (recording !== id || location.hash === ours) return;
    ours = location.hash;
    const place = readPlace(query ?? "");
    replay.go(place);
    takeWorkspace(app, replay, place);
  });
  return () => {
    stop();
    moved();
  };
}

/** Problems of the samples on screen, in a band. */
function Trouble({ replay }: { readonly replay: ReplayController }) {
  const problem = replay.problem.value;
  const { damaged } = replay.detail.info;
  const share = replay.progress.value;
  return (
    <>
      {share < 1 && (
        <div class="band calm decoding" role="status">
          <b>
            {Math.round(100 * share)}
            <span class="unit">%</span>
          </b>
          <progress value={share} max={1} aria-label={TEXT.decodeProgress} />
          <span class="mid">{TEXT.firstDecode}</span>
        </div>
      )}
      {problem && <Band dot="bad" title={<Message text={problem.message} />} words={<Message text={problem.hint} />} />}
      {damaged !== "" && (
        <Band tone="warning" dot="warn" title={TEXT.damagedFilter} words={<Message text={damaged} />} />
      )}
    </>
  );
}

/** On a phone, where the rail is a sheet: the recording, and the device whose samples are on screen. */
function PhoneHead({ recording: { replay } }: { readonly recording: OpenRecording }) {
  const { info, devices } = replay.detail;
  const chosen = replay.viewState.device.value ?? "";
  const named = (device: DeviceInfo): string => distinctName(device, devices);
  return (
    <div class="phone replay-head">
      <a class="btn icon" href={href("recordings")} aria-label={TEXT.backToTheLibrary}>
        <Icon name="left" />
      </a>
      <b>{recordingTitle(info)}</b>
      {devices.length > 1 ? (
        <Select
          label={TEXT.deviceOfRecording}
          value={chosen}
          options={devices.map((device) => [device.id, named(device)])}
          onChoose={(id) => replay.choose(id)}
        />
      ) : (
        <span class="mid">{devices[0] && named(devices[0])}</span>
      )}
    </div>
  );
}

/** The recording, its devices and its markers. */
function About({ recording }: { readonly recording: OpenRecording }) {
  const { replay } = recording;
  const { sheet } = recording.app;
  const { info, devices } = replay.detail;
  const { first, last } = replay.bounds;
  const size = bytes(info.size);
  return (
    <aside class={`rail ${sheet.value === "rail" ? "open" : ""}`} id="rail" aria-label={TEXT.thisRecording}>
      <div class="head">
        <a class="btn icon" href={href("recordings")} aria-label={TEXT.backToTheLibrary} title={TEXT.backToTheLibrary}>
          <Icon name="left" />
        </a>
        <h2 class="ellipsis">{recordingTitle(info)}</h2>
        <span class="grow" />
        {sheet.value === "rail" && (
          <IconButton icon="close" label={COMMON.close} onClick={() => (sheet.value = undefined)} />
        )}
      </div>
      <p class="foot-note dim about">
        {TEXT.recordingFacts(dateWords(info.started ?? first, true), length(last - first), size.value, size.unit)}
        {info.notes && <span class="notes">{info.notes}</span>}
      </p>
      <HandOn recording={recording} />
      <div class="categories" role="group" aria-label={COMMON.device}>
        {devices.map((device) => (
          <button
            type="button"
            key={device.id}
            title={`${device.name} ${device.serial_number}`.trim()}
            aria-pressed={replay.viewState.device.value === device.id}
            onClick={() => replay.choose(device.id)}
          >
            <span class="ellipsis">{device.name}</span>
            <span class="count">{device.serial_number}</span>
          </button>
        ))}
      </div>
      <SettingsLine recording={recording} />
      <Markers recording={recording} />
    </aside>
  );
}
