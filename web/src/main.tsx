/** Entry point of the page: theme, store, keys, shell. */
import { effect } from "@preact/signals";
import { render } from "preact";
import { framesDrawn } from "./data/render-loop";
import { watchSampleInterval } from "./data/sample-interval";
import { Store } from "./data/store";
import { createViewState } from "./data/view-state";
import { startExtensions } from "./extension";
import { loadPorts, startApp } from "./pages/app-state";
import { startKeyboard } from "./pages/keyboard";
import { startLiveAddress } from "./pages/live-address";
import { watchRecorder } from "./pages/record-button";
import { route, startRoute } from "./pages/route";
import { showLive } from "./pages/test-hook";
import { Shell } from "./pages/shell";
import { socketUrl } from "./pages/empty-states";
import { RecentHealth } from "./panels/health-history";
import { api, isRefusal } from "./ui/http";
import { startTheme } from "./ui/theme";
import { startLastState } from "./workspace/last-state";
import "./ui/tokens.css";
import "./ui/base.css";
import "./ui/layout.css";
import "./ui/overlays.css";
import "./ui/panels.css";
import "./ui/instruments.css";
import "./ui/marks.css";
import "./ui/phone.css";
import "./ui/tabs.css";
import "./ui/record.css";
import "./ui/visibility.css";

startTheme();
const store = new Store();
const app = startApp({ store, viewState: createViewState(), recentHealth: new RecentHealth() });
startRoute();
const isLinked = route.peek().page === "live" && (route.peek().query ?? "") !== "";
startLiveAddress(app);
startLastState(app, isLinked);
watchRecorder(app);
startKeyboard(app);

// a refused WebSocket gives no reason; a plain request to the same server does
effect(() => {
  if (store.connection.value !== "closed") {
    app.refusal.value = undefined;
    return;
  }
  void api.probe().then((outcome) => {
    if (outcome.ok) return;
    const refused = isRefusal(outcome.problem) || outcome.problem.kind === "too-many-tokens";
    if (refused && store.connection.peek() !== "open") app.refusal.value = outcome.problem;
  });
});

store.start(socketUrl());
watchSampleInterval(framesDrawn, (seconds) => store.requestInterval(seconds));
void loadPorts(app);
startExtensions(app);
showLive(store, app.viewState);
const root = document.getElementById("root");
if (root) render(<Shell app={app} />, root);
