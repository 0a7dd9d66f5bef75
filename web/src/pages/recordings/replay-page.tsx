/** A recording that is open: the panels of Live over its samples, with the controls of its time under the plots. */
import { useEffect } from "preact/hooks";
import { mountAttitude } from "../../attitude/panel";
import { mountLargeTrack } from "../../attitude/track-dialog";
import { onFrame } from "../../data/render-loop";
import { view } from "../../data/view-state";
import { mountStack } from "../../plots/plot-stack";
import { placeHref, readPlace } from "../../recordings/permalink";
import { bytes, dateWords, length, titleOf } from "../../recordings/library-filter";
import type { Replay } from "../../recordings/replay-controller";
import { Dialog } from "../../ui/dialog";
import type { Panel } from "../../ui/dom";
import { Icon } from "../../ui/icons";
import { Message } from "../../ui/message";
import { Mounted } from "../../ui/panel-host";
import { RerunButton, RerunPanel } from "../../views/rerun";
import { ReplayScene, SceneLine } from "../../views/viser";
import { type App, folded, overlay, sheet } from "../app-state";
import { Bar } from "../top-bar";
import { Side } from "../live";
import { href, route } from "../route";
import { RowsDialog } from "../rows";
import { OfflineBand, ProblemBand } from "../empty-states";
import { listenForKeys } from "./keys";
import { Markers } from "./markers";
import { mountOverview } from "./overview-strip";
import { PageOverlays } from "./overlays";
import { HandOn } from "./share-menu";
import { SettingsDialog, SettingsLine } from "./settings";
import { Transport } from "./transport";

/** The address follows what is on screen this often, ms: a reload finds its place. */
const ADDRESS_MS = 1000;

export function ReplayPage({ replay, app }: { readonly replay: Replay; readonly app: App }) {
  const { info } = replay.detail;
  useEffect(() => {
    document.title = `${titleOf(info)} · imuscope`;
    const stops = [onFrame((now) => replay.tick(now)), listenForKeys(replay), keepAddress(replay)];
    return () => stops.forEach((stop) => stop());
  }, []);
  const offline = app.store.connection.value === "closed" || app.store.silentSince.value !== undefined;
  return (
    <div class={`app replay ${offline ? "offline" : ""} ${folded.value ? "folded" : ""}`}>
      <a class="btn edge skip" href="#plots">
        Skip to the plots
      </a>
      <Bar app={app} />
      {offline && <OfflineBand app={app} />}
      <About replay={replay} />
      <main class="centre">
        <h1 class="vh">{titleOf(info)}</h1>
        <ProblemBand />
        <Trouble replay={replay} />
        <SceneLine>
          <RerunButton replay={replay} />
        </SceneLine>
        <ReplayScene replay={replay} />
        <Panels key={view.value.device} replay={replay} />
        <Transport replay={replay} />
        <Mounted class="overview" label="The whole recording" mount={(host) => mountOverview(host, replay)} />
      </main>
      <Side app={replay.app} />
      {overlay.value === "track" && (
        <Dialog title={`Track of ${replay.app.device.value?.name ?? "the device"}`} wide onClose={() => (overlay.value = undefined)}>
          <Mounted class="largetrack" mount={(host) => mountLargeTrack(host, { ...replay.app, store: replay.drawn })} />
        </Dialog>
      )}
      <RowsDialog app={replay.app} />
      <RerunPanel />
      <SettingsDialog replay={replay} app={app} />
      <PageOverlays app={app} />
    </div>
  );
}

/** The instruments and the plots, as on Live: the plots draw what is on screen, everything else reads around the cursor. */
function Panels({ replay }: { readonly replay: Replay }) {
  return (
    <>
      <Mounted class="att" label="Attitude" mount={(host) => mountAttitude(host, replay.app, () => (overlay.value = "track"))} />
      <div class="plots" id="plots" tabIndex={-1}>
        <Mounted class="plothost" label="Plots" mount={(host) => mountPlots(host, replay)} />
      </div>
    </>
  );
}

function mountPlots(host: HTMLElement, replay: Replay): Panel {
  const stack = mountStack(host, {
    store: replay.drawn,
    reads: (channel, t) => replay.reads(channel, t),
    bounds: () => replay.bounds,
    markers: () => replay.markers.peek(),
  });
  const resized = new ResizeObserver(() => {
    const style = getComputedStyle(host);
    const of = (name: string): number => parseFloat(style.getPropertyValue(name)) || 0;
    replay.pixels = Math.max(200, host.clientWidth - of("--gutter-w") - of("--tail-w"));
  });
  resized.observe(host);
  return {
    update: (now) => stack.update(now),
    dispose() {
      resized.disconnect();
      stack.dispose();
    },
  };
}

/** While it is paused the address is that of what is on screen; a link that is opened over it moves there. */
function keepAddress(replay: Replay): () => void {
  const { id } = replay.detail.info;
  let ours = location.hash;
  const timer = setInterval(() => {
    const next = placeHref(id, replay.place());
    if (replay.playing.peek() || next === ours || location.hash !== ours) return;
    ours = next;
    history.replaceState(null, "", next);
  }, ADDRESS_MS);
  const moved = route.subscribe(({ recording, query }) => {
    if (recording !== id || location.hash === ours) return;
    ours = location.hash;
    replay.go(readPlace(query ?? ""));
  });
  return () => {
    clearInterval(timer);
    moved();
  };
}

/** What is wrong with the samples on screen, in a band of its own. */
function Trouble({ replay }: { readonly replay: Replay }) {
  const problem = replay.problem.value;
  const { damaged } = replay.detail.info;
  const share = replay.progress.value;
  return (
    <>
      {share < 1 && (
        <div class="band calm decoding" role="status">
          <b>
            {Math.round(100 * share)}
            <span class="u">%</span>
          </b>
          <progress value={share} max={1} aria-label="Decoded so far" />
          <span class="mid">Decoding it for the first time. What is there can be looked at already.</span>
        </div>
      )}
      {problem && (
        <div class="band" role="alert">
          <span class="dot bad" />
          <b><Message text={problem.message} /></b>
          <span class="mid"><Message text={problem.hint} /></span>
        </div>
      )}
      {damaged !== "" && (
        <div class="band caution" role="status">
          <span class="dot warn" />
          <b>Damaged</b>
          <span class="mid"><Message text={damaged} /></span>
        </div>
      )}
    </>
  );
}

/** The recording, its devices and its markers. */
function About({ replay }: { readonly replay: Replay }) {
  const { info, devices } = replay.detail;
  const { first, last } = replay.bounds;
  const size = bytes(info.size);
  return (
    <aside class={`rail ${sheet.value === "rail" ? "open" : ""}`} id="rail" aria-label="This recording">
      <div class="head">
        <a class="btn icon" href={href("recordings")} aria-label="Back to the library" title="Back to the library">
          <Icon name="left" />
        </a>
        <h2 class="ell">{titleOf(info)}</h2>
        <span class="grow" />
        {sheet.value === "rail" && (
          <button type="button" class="btn icon" aria-label="Close" onClick={() => (sheet.value = undefined)}>
            <Icon name="close" />
          </button>
        )}
      </div>
      <p class="foot-note dim about">
        {dateWords(info.started ?? first, true)} UTC · {length(last - first)} · {size.value} {size.unit}
        {info.notes && <span class="notes">{info.notes}</span>}
      </p>
      <HandOn replay={replay} />
      <div class="cats" role="group" aria-label="Device">
        {devices.map((device) => (
          <button
            type="button"
            key={device.id}
            title={`${device.name} ${device.serial_number}`.trim()}
            aria-pressed={view.value.device === device.id}
            onClick={() => replay.choose(device.id)}
          >
            <span class="ell">{device.name}</span>
            <span class="c">{device.serial_number}</span>
          </button>
        ))}
      </div>
      <SettingsLine replay={replay} />
      <Markers replay={replay} />
    </aside>
  );
}
