/** Entry point of the page: theme, store, keys, shell. */
import { effect } from "@preact/signals";
import { render } from "preact";
import { framesDrawn } from "../data/render-loop";
import { watchSampleInterval } from "../data/sample-interval";
import { Store } from "../data/store";
import { createViewState } from "../data/view-state";
import { startExtensions, loadPorts, startApp } from "../page/app-state";
import { startKeyboard } from "../pages/keyboard";
import { startLiveAddress } from "../pages/live-address";
import { watchRecorder } from "../pages/record-button";
import { route, startRoute } from "../page/route";
import { showLive } from "../pages/test-hook";
import { Shell } from "./shell";
import { RecentHealth } from "../data/health-history";
import { api, isRefusal, NO_SOCKET } from "../requests/http";
import { socketUrl } from "../requests/server-place";
import { startTheme } from "../ui/dom/theme";
import { startLastState } from "../workspace/last-state";
import "../ui/tokens.css";
import "../ui/base.css";
import "../ui/layout.css";
import "../ui/overlays.css";
import "../ui/panels.css";
import "../ui/instruments.css";
import "../ui/marks.css";
import "../ui/phone.css";
import "../ui/tabs.css";
import "../ui/record.css";
import "../ui/visibility.css";

startTheme();
const store = new Store();
const app = startApp({ store, viewState: createViewState(), recentHealth: new RecentHealth() });
startRoute();
const isLinked = route.peek().page === "live" && (route.peek().query ?? "") !== "";
startLiveAddress(app);
startLastState(app, isLinked);
watchRecorder(app);
startKeyboard(app);

explainRefusals();
store.start(socketUrl("/ws"));
watchSampleInterval(framesDrawn, (seconds) => store.requestInterval(seconds));
void loadPorts(app);
startExtensions(app);
showLive(store, app.viewState);
const root = document.getElementById("root");
if (root) render(<Shell app={app} />, root);

/** A refused WebSocket gives no reason; a plain request to the same server does. Where that is answered twice, the WebSocket alone fails. */
function explainRefusals(): void {
  let answered = 0;
  effect(() => {
    if (store.connection.value === "open") {
      app.refusal.value = undefined;
      answered = 0;
    }
    if (store.connection.value !== "closed") return;
    void api.probe().then((outcome) => {
      if (store.connection.peek() === "open") return;
      answered = outcome.ok ? answered + 1 : 0;
      const problem = outcome.ok ? undefined : outcome.problem;
      const refused = problem && (isRefusal(problem) || problem.kind === "too-many-tokens");
      app.refusal.value = refused ? problem : answered > 1 ? NO_SOCKET : undefined;
    });
  });
}
