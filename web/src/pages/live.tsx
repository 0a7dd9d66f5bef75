/** The Live page: devices on the left, attitude and plots in the middle, values and health on the right. */
import { fromExtensions, Slot } from "../extension/extension";
import { placesOf } from "../plots/markers";
import { mountStack } from "../plots/plot-stack";
import type { UnderPlots } from "../plots/under-plots";
import { showsPlots } from "../page/page-state";
import { MainColumn } from "../workspace/main-column";
import { ArrangeTools } from "../workspace/arrange";
import { useWorkspace } from "../workspace/use-workspace";
import { sideWidthOf } from "../workspace/side-width";
import { LiveViewer, LiveViews } from "../views/viewers";
import { select, askKey, linkOf, run } from "../page/app-state";
import type { App } from "../page/context";
import { LateAddDevice, LateMemoryDialog, LateSignalsPanel, LateYAxisDialog } from "./dialogs";
import { FirstMinute } from "./first-minute";
import { TopBar, Dock } from "./top-bar";
import { PageOverlays } from "./overlays";
import { Rail } from "./device-sidebar";
import { RowsDialog } from "./rows";
import { SideColumn, Strip } from "./side-panels";
import {
  Connecting,
  Denied,
  Empty,
  HeldBand,
  OfflineBand,
  LinkedBand,
  ProblemBand,
  Loading,
  Silent,
  Starting,
  Unreached,
} from "./empty-states";
import { fullName } from "../wire/device-name";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";
import { keyWanted, keyWrong, trustOf } from "../panels/authenticity";
import { Button } from "../ui/controls/button";
import { api } from "../requests/http";
import { Band } from "../ui/controls/band";
import { Message } from "../ui/controls/message";

export function LivePage({ app }: { readonly app: App }) {
  const state = app.state.value;
  const root = useWorkspace(app, app.viewState);
  const offline = app.store.isCut && state !== "starting";
  const classes = [
    "app",
    app.folded.value ? "folded" : "",
    showsPlots(state) ? "" : "plain",
    offline ? "offline" : "",
    app.held() ? "held" : "",
  ]
    .filter(Boolean)
    .join(" ");
  return (
    <div ref={root} class={classes} data-state={state} style={sideWidthOf(app.viewState)}>
      {showsPlots(state) && (
        <a class="btn edge skip" href="#plots">
          {COMMON.skipToThePlots}
        </a>
      )}
      <TopBar app={app} />
      {offline && <OfflineBand app={app} />}
      {showsPlots(state) && <Strip deps={app} />}
      <Rail app={app} />
      <main class="centre">
        <h1 class="visually-hidden">
          {TEXT.live}
          {app.device.value ? `: ${fullName(app.device.value)}` : ""}
        </h1>
        <FirstMinute app={app} />
        <ProblemBand app={app} />
        <LinkedBand app={app} />
        <KeyBand app={app} />
        <RearmBand app={app} />
        <Centre app={app} />
      </main>
      {showsPlots(state) && <SideColumn app={app} deps={app} />}
      {showsPlots(state) && <Dock app={app} />}
      {showsPlots(state) && app.showsSignals.value && (
        <LateSignalsPanel deps={app} tick={app.tick} isLive onClose={() => (app.showsSignals.value = false)} />
      )}
      {showsPlots(state) && <ArrangeTools app={app} deps={app} />}
      <RowsDialog app={app} deps={app} />
      <Overlays app={app} />
    </div>
  );
}

function Centre({ app }: { readonly app: App }) {
  const state = app.state.value;
  const device = app.device.value;
  if (state === "starting") return <Starting app={app} />;
  if (state === "empty" || !device) return <Empty app={app} />;
  if (state === "connecting") return <Connecting app={app} device={device} />;
  if (state === "denied") return <Denied app={app} device={device} />;
  if (state === "unreached") return <Unreached app={app} device={device} />;
  if (state === "loading") return <Loading device={device} />;
  if (state === "silent") return <Silent app={app} device={device} />;
  return (
    <MainColumn
      app={app}
      deps={app}
      mountPlots={(host, tile) =>
        mountStack(host, { store: app.store, viewState: app.viewState, open: app.open, ...tile })
      }
      under={
        <>
          <Slot key={device.id} name="underPlots" with={underPlots(app)} />
          {app.viewState.yAxisForm.value && <LateYAxisDialog viewState={app.viewState} />}
        </>
      }
    >
      {state !== "live" && <HeldBand app={app} device={device} />}
      <LiveViews app={app} />
      <LiveViewer app={app} device={device} />
    </MainColumn>
  );
}

function underPlots({ store, viewState }: App): UnderPlots {
  const device = (): string => viewState.view.peek().device ?? "";
  return {
    viewState,
    source: device,
    places(kind) {
      if (kind === "gap") return store.losses(device()).map(({ t0 }) => t0);
      return placesOf(store.events.peek(), kind, device());
    },
  };
}

function Overlays({ app }: { readonly app: App }) {
  const { overlay, keyFor } = app;
  const close = (): void => {
    overlay.value = undefined;
    keyFor.value = undefined;
  };
  if (overlay.value === "add") {
    const added = (id: string | undefined): void => {
      close();
      if (id !== undefined) select(app, id);
    };
    return <LateAddDevice begin={keyFor.value} address={app.newAddress} onClose={close} onAdded={added} />;
  }
  if (overlay.value === "memory") return <LateMemoryDialog app={app} onClose={close} />;
  const dialog = fromExtensions("dialogs").find((one) => one.overlay === overlay.value);
  if (dialog?.Live && app.device.value)
    return <dialog.Live key={app.device.value.id} app={app} device={app.device.value} onClose={close} />;
  return <PageOverlays app={app} />;
}

/** Secure devices on the link of the selected one that restarted: their frames are refused until an operator re-arms them. */
function RearmBand({ app }: { readonly app: App }) {
  const device = app.device.value;
  if (!device) return null;
  const link = app.store.devices.value.find(({ id }) => id === linkOf(device)) ?? device;
  return (
    <>
      {link.rearm.map((sender) => (
        <Band
          key={sender}
          tone="warning"
          dot="warn"
          title={TEXT.sequenceRestarted(sender)}
          words={TEXT.oldSequenceNumbers(sender)}
          data-rearm={sender}
        >
          <Button
            changes
            look="edge"
            words={TEXT.rearm(sender)}
            onClick={() => void run(app, api.rearmDevice(link.id, sender))}
          />
        </Band>
      ))}
    </>
  );
}

/** For the selected device: frames that need a key, a wrong key, or data that could not be verified. */
function KeyBand({ app }: { readonly app: App }) {
  const device = app.device.value;
  if (!device) return null;
  const health = app.store.health.value.get(device.id);
  const unverified = trustOf(device, health)?.state === "unverified" && device.protocol !== "";
  const refused = keyWanted(health) || keyWrong(health);
  if (!unverified && refused === "") return null;
  const words = (
    <>
      {unverified ? TEXT.unverifiedData : <Message text={`${refused} `} />}
      {TEXT.enterKeyHere} <code>{TEXT.keyOption}</code>.
    </>
  );
  const title = unverified ? TEXT.shownUnverified : TEXT.keyNeeded;
  return (
    <Band tone="warning" dot="warn" title={title} words={words} data-key="wanted">
      <Button changes look="edge" words={TEXT.enterKey} onClick={() => askKey(app, device)} />
    </Band>
  );
}
