/** A fleet: its robots, questions about a store of recordings, and the way back from a robot's page. */
import { registerExtension } from "../../extension/extension";
import type { App } from "../../page/context";
import { LivePage } from "../../pages/live";
import { late } from "../../ui/dom/late";
import { askServerKind, serverKind } from "./server-kind";
import { ThroughFleetBand } from "./through-fleet";
import { TEXT } from "./texts";
import { UploadFacts, UploadMark } from "./uploads/marks";
import "./layers.css";

const loading = <div class="app" aria-busy="true" />;
const FleetPage = late(async () => (await import("./robots/page")).FleetPage, loading);
const QuestionsPage = late(async () => (await import("./questions/page")).QuestionsPage, loading);

/** Other servers have no robots to show. */
function Robots({ app }: { readonly app: App }) {
  return serverKind(app).isFleet.value ? <FleetPage app={app} /> : <LivePage app={app} />;
}

registerExtension({
  name: "fleet",
  start: (app) => void askServerKind(app),
  pages: [
    {
      name: "fleet",
      title: TEXT.fleet,
      icon: "grid",
      isRemote: true,
      isOffered: (app) => serverKind(app).isFleet.value,
      View: Robots,
    },
    {
      name: "questions",
      title: TEXT.questions,
      icon: "search",
      isOffered: (app) => serverKind(app).hasStore.value,
      View: QuestionsPage,
    },
  ],
  views: [
    { slot: "bands", order: 10, View: ThroughFleetBand },
    { slot: "recordingRow", order: 10, View: UploadMark },
    { slot: "recordingDetails", order: 10, View: UploadFacts },
  ],
});
