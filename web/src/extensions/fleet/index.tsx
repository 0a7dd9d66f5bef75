/** A fleet: its robots, questions about a store of recordings, and the way back from a robot's page. */
import { registerExtension } from "../../extension/extension";
import type { App } from "../../page/context";
import { LivePage } from "../../pages/live";
import { late } from "../../ui/dom/late";
import { askServerKind, serverKind } from "./server-kind";
import { TEXT } from "./texts";
import { UploadFacts, UploadMark } from "./uploads/marks";
import { number } from "../../ui/format/format";
import { fleetRoot, shownRobot } from "../../requests/server-place";
import "./layers.css";
import "./through-fleet.css";

const loading = <div class="app" aria-busy="true" />;
const FleetPage = late(async () => (await import("./robots/page")).FleetPage, loading);
const QuestionsPage = late(async () => (await import("./questions/page")).QuestionsPage, loading);

function ThroughFleetBand({ app }: { readonly app: App }) {
  const name = shownRobot();
  if (name === undefined) return null;
  const seconds = app.store.roundTrip.value;
  return (
    <div class="band calm through-fleet" role="group" aria-label={TEXT.line}>
      <b class="ellipsis">{name}</b>
      <span class="mid ellipsis" title={TEXT.hint}>
        {TEXT.through}
      </span>
      <span class="grow" />
      <span class="mid figure" title={TEXT.roundTripHint}>
        {TEXT.roundTrip} {seconds === undefined ? "—" : number(seconds * 1000, 0)}
        <span class="unit">ms</span>
      </span>
      <a class="btn edge" href={`${fleetRoot()}/#/fleet?${new URLSearchParams({ robot: name })}`}>
        {TEXT.fleet}
      </a>
    </div>
  );
}

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
