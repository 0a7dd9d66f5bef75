/** The band of a robot's page at its fleet server: which robot, how far away, and the way back. */
import type { App } from "../../page/context";
import { number } from "../../ui/format/format";
import { fleetRoot, shownRobot } from "../../requests/server-place";
import { TEXT } from "./texts";
import "./through-fleet.css";

export function ThroughFleetBand({ app }: { readonly app: App }) {
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
