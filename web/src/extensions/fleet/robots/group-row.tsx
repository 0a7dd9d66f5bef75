/** The head of a group: how many robots it has, and how many of them are in trouble. */
import { number } from "../../../ui/format/format";
import { Icon } from "../../../ui/controls/icons";
import type { Fleet } from "./fleet-state";
import { inShown, type Line, type RobotFilter } from "./order";
import { rowProperties } from "./roles";
import { TEXT } from "./texts";

interface Props {
  readonly id: string;
  readonly index: number;
  readonly line: Line & { readonly kind: "group" };
  readonly fleet: Fleet;
  readonly isActive: boolean;
  readonly isFolded: boolean;
  readonly top: number;
  readonly onFold: (title: string) => void;
}

/** What is counted of a group, worst first. */
const TOLD: readonly { readonly name: RobotFilter; readonly tone: string }[] = [
  { name: "lost", tone: "bad" },
  { name: "alarms", tone: "bad" },
  { name: "loss", tone: "warn" },
  { name: "fix", tone: "warn" },
  { name: "drifted", tone: "warn" },
];

export function GroupRow({ id, index, line, fleet, isActive, isFolded, top, onFold }: Props) {
  const { title, names } = line;
  void fleet.version.value;
  const robots = names.flatMap((name) => fleet.robots.get(name) ?? []);
  return (
    <div
      {...rowProperties({ id, index, top }, { "aria-expanded": !isFolded }, () => onFold(title))}
      class={`fleet-row fleet-group ${isActive ? "active" : ""}`}
    >
      <span role="gridcell" class="group-cell">
        <Icon name={isFolded ? "forward" : "down"} />
        <b class="ellipsis">{title || TEXT.ungrouped[fleet.place.value.grouping]}</b>
        <span class="dim">{TEXT.robotCount(names.length)}</span>
        {TOLD.map(({ name, tone }) => {
          const n = robots.filter((robot) => inShown(robot, name)).length;
          return n === 0 ? null : (
            <span key={name} class="in-trouble">
              <span class={`dot ${tone}`} /> {number(n, 0)} <span class="desk">{TEXT.shown[name].toLowerCase()}</span>
            </span>
          );
        })}
      </span>
    </div>
  );
}
