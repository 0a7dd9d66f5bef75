/**
 * The fleet as a map: one cell for each robot, in the order of names, so that a robot has one place whatever happens to it.
 *
 * Filters and search do not remove cells: what they leave out is faint. Keys move between cells as they lie on screen; the focus stays on
 * the map, which names the active cell.
 */
import { useSignal } from "@preact/signals";
import { Component, type JSX } from "preact";
import { useRef } from "preact/hooks";
import { cellOf, deviceWords, stateWord } from "./columns";
import type { Tone } from "./conditions";
import type { Fleet } from "./fleet-state";
import { inShown, mapGroups, robotMatches, queryWords } from "./order";
import type { Robot } from "./robots";
import { ageText } from "./row";
import { TEXT } from "./texts";

interface CellProps {
  readonly id: string;
  readonly name: string;
  readonly tone: Tone | undefined;
  /** Read aloud. */
  readonly label: string;
  readonly isFaint: boolean;
  readonly isActive: boolean;
  readonly isOpen: boolean;
}

class MapCell extends Component<CellProps> {
  override shouldComponentUpdate(next: Readonly<CellProps>): boolean {
    const now = this.props;
    for (const name in next) if (next[name as keyof CellProps] !== now[name as keyof CellProps]) return true;
    return false;
  }

  override render({ id, name, tone, label, isFaint, isActive, isOpen }: CellProps): JSX.Element {
    const classes = ["map-cell", tone ?? "", isFaint ? "faint" : "", isActive ? "active" : "", isOpen ? "on" : ""];
    return (
      <span role="option" id={id} aria-label={label} aria-selected={isOpen} data-robot={name} class={classes.join(" ")}>
        <span class={`dot ${tone ?? ""}`} />
      </span>
    );
  }
}

export function FleetMap({ fleet }: { readonly fleet: Fleet }) {
  const box = useRef<HTMLDivElement>(null);
  const active = useSignal<string | undefined>(undefined);
  const over = useSignal<string | undefined>(undefined);
  void fleet.version.value;
  const { grouping, shown, query, robot: open } = fleet.place.value;
  const words = queryWords(query);
  const groups = mapGroups(fleet.robots.namesInOrder(), (name) => fleet.robots.get(name), grouping);
  const names = groups.flatMap((group) => group.names);
  const activeIndex = active.value === undefined ? -1 : names.indexOf(active.value);
  const idOf = (index: number): string => `fleet-cell-${index}`;

  const choose = (name: string): void => {
    active.value = name;
    over.value = undefined;
    document.getElementById(idOf(names.indexOf(name)))?.scrollIntoView({ block: "nearest" });
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey || names.length === 0) return;
    const at = Math.max(0, activeIndex);
    const vertical = event.key === "ArrowDown" ? 1 : event.key === "ArrowUp" ? -1 : 0;
    const next: Readonly<Record<string, number>> = {
      ArrowRight: activeIndex + 1,
      ArrowLeft: at - 1,
      Home: 0,
      End: names.length - 1,
    };
    const move = vertical === 0 ? next[event.key] : activeIndex < 0 ? 0 : neighbour(box.current, at, vertical);
    if (event.key === "Enter" && activeIndex >= 0) fleet.open(names[activeIndex] ?? "");
    else if (move !== undefined) choose(names[Math.max(0, Math.min(names.length - 1, move))] ?? "");
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  const nameAt = (event: Event): string | undefined =>
    event.target instanceof Element ? event.target.closest<HTMLElement>("[data-robot]")?.dataset["robot"] : undefined;
  const onClick = (event: MouseEvent): void => {
    const name = nameAt(event);
    if (name === undefined) return;
    active.value = name;
    fleet.open(name);
  };
  let index = 0;
  const told = fleet.robots.get(over.value ?? active.value ?? "");
  return (
    <>
      <div
        ref={box}
        class="fleet-map"
        role="listbox"
        tabIndex={0}
        aria-label={TEXT.robots}
        aria-activedescendant={activeIndex < 0 ? undefined : idOf(activeIndex)}
        onKeyDown={onKeyDown}
        onClick={onClick}
        onPointerOver={(event) => void (over.value = nameAt(event))}
        onPointerLeave={() => void (over.value = undefined)}
      >
        {groups.map(({ title, names: members }) => (
          <div
            key={title}
            {...(grouping === "none"
              ? { role: "presentation" }
              : { role: "group", "aria-label": title || TEXT.ungrouped[grouping] })}
            class="map-group"
          >
            {grouping !== "none" && (
              <p aria-hidden="true">
                <b>{title || TEXT.ungrouped[grouping]}</b> <span class="dim">{TEXT.robotCount(members.length)}</span>
              </p>
            )}
            <div class="map-cells" role="presentation">
              {members.map((name) => {
                const robot = fleet.robots.get(name);
                if (!robot) return null;
                const at = index++;
                return (
                  <MapCell
                    key={name}
                    id={idOf(at)}
                    name={name}
                    tone={robot.health.tone}
                    label={TEXT.mapCell(name, stateWord(robot))}
                    isFaint={!inShown(robot, shown) || !robotMatches(robot, words)}
                    isActive={at === activeIndex}
                    isOpen={name === open}
                  />
                );
              })}
            </div>
          </div>
        ))}
      </div>
      <p class="map-line flex-row text-sm">
        {told ? <Told robot={told} now={fleet.now()} /> : <span class="dim">{TEXT.mapHint}</span>}
      </p>
    </>
  );
}

/** The robot under the pointer, or the active one, in a line. */
function Told({ robot, now }: { readonly robot: Robot; readonly now: number }) {
  const { summary, health, device } = robot;
  const isLost = summary.state === "lost";
  const rate = isLost || device === undefined ? undefined : cellOf("rate", robot);
  return (
    <>
      <span class={`dot ${health.tone ?? "live"}`} />
      <b>{summary.name}</b>
      <span>{isLost ? `${TEXT.lost} ${ageText(now, summary.since)}` : conditionWords(robot)}</span>
      <span class="mid">{summary.group}</span>
      <span class="mid ellipsis">{deviceWords(device)}</span>
      {rate && (
        <span class="mid">
          {rate.text}
          <span class="unit">{rate.unit}</span>
        </span>
      )}
    </>
  );
}

const conditionWords = ({ health }: Robot): string =>
  health.conditions.map((name) => TEXT.conditions[name]).join(", ") || TEXT.live;

/** Index of the nearest cell in the next line of cells above or below. */
function neighbour(box: HTMLElement | null, from: number, direction: number): number {
  const cells = [...(box?.querySelectorAll<HTMLElement>(".map-cell") ?? [])];
  const here = cells[from];
  if (!here) return 0;
  const beyond = cells.filter((cell) => direction * (cell.offsetTop - here.offsetTop) > 0);
  const line = beyond.reduce(
    (best, { offsetTop }) => direction * Math.min(direction * best, direction * offsetTop),
    direction * Infinity,
  );
  let [found, distance] = [from, Infinity];
  cells.forEach((cell, i) => {
    const away = Math.abs(cell.offsetLeft - here.offsetLeft);
    if (cell.offsetTop === line && away < distance) [found, distance] = [i, away];
  });
  return found;
}
