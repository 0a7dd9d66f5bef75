/** Where the page starts: theme, store, keys, shell. */
import { effect } from "@preact/signals";
import { render } from "preact";
import * as actions from "./data/view-actions";
import { framesDrawn } from "./data/render-loop";
import { watchSampleInterval } from "./data/sample-interval";
import { Store } from "./data/store";
import { cursor, view } from "./data/view-state";
import { loadPorts, startApp } from "./pages/app-state";
import { startDrop } from "./pages/drop";
import { startKeyboard } from "./pages/keyboard";
import { startLiveAddress } from "./pages/live-address";
import { watchRecorder } from "./pages/record-button";
import { startRoute } from "./pages/route";
import { Shell } from "./pages/shell";
import { refusal, socketUrl } from "./pages/empty-states";
import { Minute } from "./panels/health-history";
import { api, isRefusal } from "./ui/http";
import { startTheme } from "./ui/theme";
import "./ui/tokens.css";
import "./ui/base.css";
import "./ui/layout.css";
import "./ui/overlays.css";
import "./ui/panels.css";
import "./ui/instruments.css";
import "./ui/unknown-payloads.css";
import "./ui/phone.css";
import "./ui/tabs.css";
import "./ui/record.css";

declare global {
  interface Window {
    /** For the browser tests and for curious people with a console. */
    imuscope?: unknown;
  }
}

startTheme();
const store = new Store();
const app = startApp({ store, minute: new Minute() });
startRoute();
startLiveAddress();
watchRecorder(app);
startKeyboard(app);
startDrop();

// A refused WebSocket does not say why; a plain request to the same server does.
effect(() => {
  if (store.connection.value !== "closed") {
    refusal.value = undefined;
    return;
  }
  void api.probe().then((outcome) => {
    if (outcome.ok) return;
    const refused = isRefusal(outcome.problem) || outcome.problem.kind === "too-many-tokens";
    if (refused && store.connection.peek() !== "open") refusal.value = outcome.problem;
  });
});

store.start(socketUrl());
watchSampleInterval(framesDrawn, (seconds) => store.requestInterval(seconds));
void loadPorts();
window.imuscope = { store, view, cursor, actions };
const root = document.getElementById("root");
if (root) render(<Shell app={app} />, root);
