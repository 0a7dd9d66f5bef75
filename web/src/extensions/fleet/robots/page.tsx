/** The page of a fleet: all robots at a glance, those that need somebody first. Loaded on a fleet server only. */
import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect } from "preact/hooks";
import type { App } from "../../../page/context";
import { ProblemBand } from "../../../pages/empty-states";
import { TopBar } from "../../../pages/top-bar";
import { Button } from "../../../ui/controls/button";
import { Band } from "../../../ui/controls/band";
import { Card } from "../../../ui/controls/card";
import { copyText } from "../../../ui/dom/copy";
import { age } from "../../../ui/format/format";
import { Help } from "../../../pages/help";
import { Message } from "../../../ui/controls/message";
import { RobotDetails } from "./details";
import { type Fleet, fleetOf } from "./fleet-state";
import { List } from "./list";
import { FleetMap } from "./map";
import { START } from "./address";
import { Summary, Tools } from "./tools";
import { usePhone } from "../../../ui/controls/use-phone";
import { COMMON } from "../../../texts/common";
import { TEXT } from "./texts";
import type { KeyGroup } from "../../../page/keys";
import "./fleet.css";
import "./phone.css";

export function FleetPage({ app }: { readonly app: App }) {
  const fleet = fleetOf(app);
  useEffect(() => {
    document.title = TEXT.title;
    return fleet.follow();
  }, [fleet]);
  useLayoutEffect(() => fleet.followAddress(), [fleet]); // ended at once, before another page writes the address
  const { place, isKnown } = fleet;
  const isCut = isKnown.value && fleet.isCut.value;
  const isOpen = place.value.robot !== "";
  return (
    <div class={`app fleet ${isOpen ? "detailed" : ""} ${isCut ? "cut" : ""}`}>
      <a class="btn edge skip" href="#list">
        {TEXT.skipToTheList}
      </a>
      <TopBar app={app} />
      <main class="fleet-centre flex-column" id="list" tabIndex={-1}>
        <h1 class="visually-hidden">{TEXT.robots}</h1>
        <ProblemBand app={app} />
        {isCut && <CutBand app={app} fleet={fleet} />}
        <Content fleet={fleet} />
      </main>
      {isOpen && <RobotDetails fleet={fleet} />}
      {app.overlay.value === "help" && <Help groups={FLEET_KEYS} onClose={() => (app.overlay.value = undefined)} />}
    </div>
  );
}

function Content({ fleet }: { readonly fleet: Fleet }) {
  const isPhone = usePhone(); // cells of the map are too small for a finger
  void fleet.version.value;
  if (!fleet.isKnown.value) return <Waiting fleet={fleet} />;
  if (fleet.robots.all.size === 0) return <NoRobot />;
  const isMap = fleet.place.value.view === "map" && !isPhone;
  const isEmpty = fleet.lines.value.length === 0;
  return (
    <>
      <Summary fleet={fleet} />
      <Tools fleet={fleet} />
      {isMap ? <FleetMap fleet={fleet} /> : isEmpty ? <NoMatch fleet={fleet} /> : <List fleet={fleet} />}
    </>
  );
}

/** Figures stay while the server is away, grey and with their age. */
function CutBand({ app, fleet }: { readonly app: App; readonly fleet: Fleet }) {
  void app.tick.value;
  const old = age(performance.now() / 1000 - fleet.answered.value.here);
  const problem = fleet.problem.value;
  const words = `${TEXT.cutHint(old.value, old.unit)} ${problem ? `${problem.message} ${problem.hint}` : ""}`;
  return (
    <Band dot="bad" title={fleet.isRefused ? TEXT.refused : TEXT.cut} words={<Message text={words} />}>
      <Button look="edge" words={TEXT.retry} onClick={() => fleet.retry()} />
    </Band>
  );
}

function Waiting({ fleet }: { readonly fleet: Fleet }) {
  const problem = fleet.problem.value;
  return (
    <Card
      title={problem ? (fleet.isRefused ? TEXT.refused : TEXT.failed) : TEXT.connecting}
      dot={problem ? "bad" : "off"}
      message={problem?.message}
      hint={problem && (problem.hint || TEXT.refusedHint)}
      aria-busy={problem === undefined}
    >
      {problem && (
        <div class="row">
          <Button look="main" words={TEXT.retry} onClick={() => fleet.retry()} />
        </div>
      )}
    </Card>
  );
}

/** The port of a fleet server, unless it was started with another one. */
const PORT = 7447;

function NoRobot() {
  const said = useSignal("");
  const isHere = /^(localhost|127\..*|\[::1\])$/.test(location.hostname);
  // beyond this machine the bus has TLS, or the server would not have started without being told so
  const command = `imuscope serve --fleet ${isHere ? "tcp" : "tls"}/${location.hostname}:${PORT}`;
  const copy = async (): Promise<void> => {
    said.value = (await copyText(command)) ? COMMON.copied : TEXT.copyFailed;
  };
  return (
    <Card title={TEXT.noRobot} message={TEXT.noRobotHint}>
      <p class="hint">
        <code>{command}</code>
      </p>
      <p>{isHere ? TEXT.addressHint : TEXT.accessHint}</p>
      <div class="row">
        <Button look="main" icon="share" words={TEXT.copyCommand} onClick={() => void copy()} />
        <span class="mid" role="status">
          {said.value}
        </span>
      </div>
    </Card>
  );
}

function NoMatch({ fleet }: { readonly fleet: Fleet }) {
  const showAll = (): void => fleet.choose({ query: START.query, shown: START.shown });
  return (
    <Card title={TEXT.noMatch} message={TEXT.noMatchHint}>
      <div class="row">
        <Button look="main" words={TEXT.showAll} onClick={showAll} />
      </div>
    </Card>
  );
}

const FLEET_KEYS: readonly KeyGroup[] = [
  {
    title: TEXT.robots,
    lines: [
      { keys: ["↑", "↓"], what: TEXT.keyMove },
      { keys: ["Page ↑", "Page ↓", "Home", "End"], what: TEXT.keyFar },
      { keys: ["Enter"], what: TEXT.keyOpen },
      { keys: ["←", "→"], what: TEXT.keyExpand },
      { keys: ["S"], what: TEXT.keySort },
    ],
  },
  {
    title: COMMON.keysOfPages,
    lines: [
      { keys: ["G F", "G R"], what: TEXT.keyPages },
      { keys: ["/"], what: TEXT.search },
      { keys: ["?"], what: COMMON.keyboard },
      { keys: ["Esc"], what: TEXT.closeDetails },
    ],
  },
];
