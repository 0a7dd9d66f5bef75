/** The page of a fleet: all robots at a glance, those that need attention first. Loaded on a fleet server only. */
import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect } from "preact/hooks";
import type { App } from "../../../page/context";
import { ProblemBand } from "../../../pages/empty-states";
import { TopBar } from "../../../pages/top-bar";
import { Button } from "../../../ui/controls/button";
import { Band } from "../../../ui/controls/band";
import { Card } from "../../../ui/controls/card";
import { copyText } from "../../../ui/dom/copy";
import { age, number } from "../../../ui/format/format";
import { Help } from "../../../pages/help";
import { Message } from "../../../ui/controls/message";
import { RobotDetails } from "./details";
import { type Fleet, fleetOf } from "./fleet-state";
import { List } from "./list";
import { FleetMap } from "./map";
import { START } from "./address";
import { usePhone } from "../../../ui/controls/use-phone";
import { COMMON } from "../../../texts/common";
import { TEXT } from "./texts";
import type { KeyGroup } from "../../../page/keys";
import { Segmented, Select } from "../../../ui/controls/choices";
import { IconButton } from "../../../ui/controls/icon-button";
import { SearchField } from "../../../ui/controls/search-field";
import { COLUMNS, columnNamed } from "./columns";
import { CONDITIONS, toneOfAlarms } from "./conditions";
import { GROUPINGS, SHOWN, type RobotFilter } from "./order";
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

interface Props {
  readonly fleet: Fleet;
}

/** Filters that are there even if they show no robot, so that nothing moves when one falls ill. */
const ALWAYS: ReadonlySet<RobotFilter> = new Set(["all", "live", "lost", "alarms", "loss", "fix", "drifted"]);

const VIEWS = ["list", "map"] as const;

const toneOf = (shown: RobotFilter, fleet: Fleet): string => {
  if (shown === "live" || shown === "all") return "";
  if (shown === "alarms") return toneOfAlarms([...fleet.robots.all.values()]);
  return CONDITIONS.find(({ name }) => name === shown)?.tone ?? "";
};

function Summary({ fleet }: Props) {
  const counts = fleet.counts.value;
  const { shown } = fleet.place.value;
  return (
    <div class="fleet-summary flex-wrap" role="group" aria-label={TEXT.summary}>
      {SHOWN.filter((name) => ALWAYS.has(name) || counts[name] > 0 || name === shown).map((name) => (
        <button
          type="button"
          key={name}
          aria-pressed={name === shown}
          class={counts[name] === 0 ? "none" : ""}
          onClick={() => fleet.choose({ shown: name === shown ? "all" : name })}
        >
          {name !== "all" && <span class={`dot ${counts[name] > 0 ? toneOf(name, fleet) : "off"}`} />}
          <b>{number(counts[name], 0)}</b> {TEXT.shown[name]}
        </button>
      ))}
    </div>
  );
}

function Tools({ fleet }: Props) {
  useEffect(() => {
    const onKey = (event: KeyboardEvent): void => {
      const typing = event.target instanceof HTMLElement && /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName);
      if (typing || event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
      if (event.key.toLowerCase() !== "s") return;
      fleet.sortNow();
      event.preventDefault();
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  }, [fleet]);
  const place = fleet.place.value;
  const listed = fleet.groups.value.reduce((sum, { names }) => sum + names.length, 0);
  const isLate = fleet.isOutOfOrder.value;
  return (
    <div class="tools flex-row fleet-tools">
      <SearchField
        label={TEXT.search}
        placeholder={TEXT.searchHint}
        value={place.query}
        onText={(query) => fleet.choose({ query })}
        hasKey
      />
      <Select
        words={TEXT.grouping}
        label={TEXT.grouping}
        value={place.grouping}
        options={GROUPINGS.map((name) => [name, TEXT.groupings[name]])}
        onChoose={(grouping) => fleet.choose({ grouping })}
      />
      <Select
        class="fleet-sort"
        words={TEXT.sort}
        label={TEXT.sort}
        value={place.sort}
        options={COLUMNS.map(({ name, title }) => [name, title])}
        onChoose={(name) => {
          const column = columnNamed(name);
          if (column) fleet.choose({ sort: column.name, descending: column.largestFirst });
        }}
      />
      <IconButton
        icon={place.descending ? "down" : "up"}
        label={TEXT.ascending}
        class="edge fleet-sort"
        onClick={() => fleet.choose({ descending: !place.descending })}
      />
      <Segmented
        label={TEXT.view}
        class="desk"
        value={place.view}
        options={VIEWS.map((view) => [view, TEXT.views[view]])}
        onChoose={(view) => fleet.choose({ view })}
      />
      <span class="grow" />
      <span class="dim total desk">{TEXT.robotCount(listed)}</span>
      <Button
        look={`edge sort-now ${place.view === "map" ? "of-list" : ""}`}
        words={TEXT.sortNow}
        disabled={!isLate}
        title={isLate ? TEXT.sortNowHint : TEXT.inOrder}
        onClick={() => fleet.sortNow()}
      />
    </div>
  );
}
