/** Above the robots: how many there are in each condition, and search, grouping and order. */
import { useEffect } from "preact/hooks";
import { Button } from "../../../ui/controls/button";
import { Segmented, Select } from "../../../ui/controls/choices";
import { number } from "../../../ui/format/format";
import { IconButton } from "../../../ui/controls/icon-button";
import { SearchField } from "../../../ui/controls/search-field";
import { COLUMNS, columnNamed } from "./columns";
import { CONDITIONS } from "./conditions";
import type { Fleet } from "./fleet-state";
import { GROUPINGS, SHOWN, type RobotFilter } from "./order";
import { TEXT } from "./texts";

interface Props {
  readonly fleet: Fleet;
}

/** Filters that are there even if they show no robot, so that nothing moves when one falls ill. */
const ALWAYS: ReadonlySet<RobotFilter> = new Set(["all", "live", "lost", "alarms", "loss", "fix", "drifted"]);

const VIEWS = ["list", "map"] as const;

const toneOf = (shown: RobotFilter): string => {
  if (shown === "live" || shown === "all") return "";
  if (shown === "alarms") return "bad";
  return CONDITIONS.find(({ name }) => name === shown)?.tone ?? "";
};

export function Summary({ fleet }: Props) {
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
          {name !== "all" && <span class={`dot ${counts[name] > 0 ? toneOf(name) : "off"}`} />}
          <b>{number(counts[name], 0)}</b> {TEXT.shown[name]}
        </button>
      ))}
    </div>
  );
}

export function Tools({ fleet }: Props) {
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
