/** The Live page: devices on the left, attitude and plots in the middle, values and health on the right. */
import { view } from "../data/view-state";
import { mountLargeTrack } from "../attitude/track-dialog";
import { mountAttitude } from "../attitude/panel";
import { AddDevice } from "../forms/add-device";
import { mountHealth, mountStrip } from "../panels/health-panel";
import { mountNews } from "../panels/event-list";
import { mountRaws } from "../panels/unknown-payloads";
import { mountSatellites } from "../panels/satellites";
import { skyTables } from "../panels/satellite-data";
import { mountValues } from "../panels/values";
import { mountStack } from "../plots/plot-stack";
import { Dialog } from "../ui/dialog";
import { Help } from "../ui/help";
import { Icon } from "../ui/icons";
import { Message } from "../ui/message";
import { Mounted } from "../ui/panel-host";
import { showsPlots } from "../ui/page-state";
import { LiveScene, LiveViews } from "../views/viser";
import { type App, describing, folded, keyFor, overlay, select, sheet } from "./app-state";
import { Bar, Dock } from "./top-bar";
import { Describe } from "./payload-dialog";
import { Rail } from "./device-sidebar";
import { openTable, RowsDialog } from "./rows";
import { KeyBand, RearmBand } from "./key-banner";
import { Connecting, Denied, Empty, HeldBand, OfflineBand, ProblemBand, Silent, Starting, Unreached } from "./empty-states";

export function LivePage({ app }: { readonly app: App }) {
  const state = app.state.value;
  const offline = app.store.isCut && state !== "starting";
  const classes = ["app", folded.value ? "folded" : "", showsPlots(state) ? "" : "plain", offline ? "offline" : "", app.held() ? "held" : ""].filter(Boolean).join(" ");
  return (
    <div class={classes} data-state={state}>
      {showsPlots(state) && (
        <a class="btn edge skip" href="#plots">
          Skip to the plots
        </a>
      )}
      <Bar app={app} />
      {offline && <OfflineBand app={app} />}
      {showsPlots(state) && <Mounted class="strip" label="Link health" scrolls mount={(host) => mountStrip(host, app)} />}
      <Rail app={app} />
      <main class="centre">
        <h1 class="vh">Live{app.device.value ? `: ${app.device.value.name}` : ""}</h1>
        <ProblemBand />
        <KeyBand app={app} />
        <RearmBand app={app} />
        <Centre app={app} />
      </main>
      <Side app={app} />
      {showsPlots(state) && <Dock />}
      <RowsDialog app={app} />
      <Overlays app={app} />
    </div>
  );
}

function Centre({ app }: { readonly app: App }) {
  const state = app.state.value;
  const device = app.device.value;
  if (state === "starting") return <Starting />;
  if (state === "empty" || !device) return <Empty />;
  if (state === "connecting") return <Connecting app={app} device={device} />;
  if (state === "denied") return <Denied device={device} />;
  if (state === "unreached") return <Unreached app={app} device={device} />;
  if (state === "silent") return <Silent device={device} />;
  return (
    <>
      <Mounted class="att" label="Attitude" mount={(host) => mountAttitude(host, app, () => (overlay.value = "track"))} />
      {state !== "live" && <HeldBand app={app} device={device} />}
      <LiveViews />
      <LiveScene device={device} several={app.store.devices.value.length > 1} />
      <div class="plots" id="plots" tabIndex={-1}>
        <Mounted class="plothost" label="Plots" mount={(host) => mountStack(host, { store: app.store })} />
      </div>
    </>
  );
}

export function Side({ app }: { readonly app: App }) {
  if (!showsPlots(app.state.value)) return null;
  const fold = (): void => {
    if (sheet.value === "side") sheet.value = undefined;
    else folded.value = true;
  };
  return (
    <aside class={`side ${sheet.value === "side" ? "open" : ""}`} id="side" aria-label="Values and health">
      <div class="head">
        <h2>Values</h2>
        <span id="values-when" />
        <span class="grow" />
        <button type="button" class="btn icon desk" aria-label="Fold this panel away" title="Fold this panel away" onClick={fold}>
          <Icon name="side" />
        </button>
      </div>
      <Mounted class="valbox" label="Values" scrolls mount={(host) => mountValues(host, { ...app, openRows: ({ name }, title) => (openTable.value = { name, title }) }, "values-when")} />
      <div class="below" role="region" aria-label="Health and events" tabIndex={0}>
      <section class="health" aria-label="Health">
        <div class="head">
          <h2>Health</h2>
          <span>last minute</span>
        </div>
        <Mounted mount={(host) => mountHealth(host, app)} />
        <Notices app={app} />
      </section>
      <Satellites app={app} />
      <RawPayloads app={app} />
      <section class="health" aria-label="Events">
        <div class="head">
          <h2>Events</h2>
          <span>newest first</span>
        </div>
        <Mounted mount={(host) => mountNews(host, app)} />
      </section>
      </div>
    </aside>
  );
}

/** Only where the device tells of satellites. */
function Satellites({ app }: { readonly app: App }) {
  const device = view.value.device;
  const known = skyTables(app.store.channels.value.filter(({ info }) => info.device === device)).length > 0;
  if (!known) return null;
  return (
    <section class="health" aria-label="Satellites">
      <div class="head">
        <h2>Satellites</h2>
        <span>
          C/N<sub>0</sub> in dB-Hz
        </span>
      </div>
      <Mounted class="skybox" mount={(host) => mountSatellites(host, app)} />
    </section>
  );
}

/** Only where the device sends what nobody has described. */
function RawPayloads({ app }: { readonly app: App }) {
  const device = view.value.device;
  if (!app.store.raws.value.some((payload) => payload.device === device)) return null;
  return (
    <section class="health" aria-label="Raw payloads">
      <div class="head">
        <h2>Raw payloads</h2>
        <span>bytes without a description</span>
      </div>
      <Mounted
        class="rawbox"
        mount={(host) =>
          mountRaws(host, app, (payload) => {
            describing.value = payload;
            overlay.value = "describe";
          })
        }
      />
    </section>
  );
}

/** Standing remarks about the link: a slow USB latency timer and its fix, who is connected, two protocols in one stream. */
function Notices({ app }: { readonly app: App }) {
  return (
    <>
      {app.device.value?.notices.map((notice) => (
        <p class="note notice" key={notice}>
          <span class="dot off" />
          <Message text={notice} />
        </p>
      ))}
    </>
  );
}

function Overlays({ app }: { readonly app: App }) {
  const close = (): void => {
    overlay.value = undefined;
    keyFor.value = undefined;
    describing.value = undefined;
  };
  if (overlay.value === "help") return <Help onClose={close} />;
  if (overlay.value === "track") {
    return (
      <Dialog title={`Track of ${app.device.value?.name ?? "the device"}`} wide onClose={close}>
        <Mounted class="largetrack" mount={(host) => mountLargeTrack(host, app)} />
      </Dialog>
    );
  }
  if (overlay.value === "add") {
    const added = (id: string | undefined): void => {
      close();
      if (id !== undefined) select(id);
    };
    return <AddDevice begin={keyFor.value} onClose={close} onAdded={added} />;
  }
  if (overlay.value === "describe" && describing.value) return <Describe app={app} payload={describing.value} onClose={close} />;
  return null;
}
