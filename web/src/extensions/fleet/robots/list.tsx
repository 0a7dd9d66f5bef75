/**
 * The robots as rows: only those in view, and some above and below, are in the document.
 *
 * Rows have one height, and each is moved to its place by itself, so that a change of a figure moves nothing else. A row that leaves the view
 * is used again for one that comes into it: to fill its cells costs a fraction of making them. Keys act on the active
 * row, which the list names for screen readers; the focus stays on the list.
 */
import { useComputed, useSignal } from "@preact/signals";
import { useCallback, useLayoutEffect, useRef } from "preact/hooks";
import { Icon } from "../../../ui/controls/icons";
import { COLUMNS } from "./columns";
import type { Fleet } from "./fleet-state";
import { toneOfAlarms } from "./conditions";
import { type Line, inShown, type RobotFilter } from "./order";
import { ageText, RobotRow } from "./row";
import { usePhone } from "../../../ui/controls/use-phone";
import { TEXT } from "./texts";
import { number } from "../../../ui/format/format";
import { rowProperties } from "./roles";

const ROW_PX = 32;
const PHONE_HEIGHT = 64;
const HEAD_PX = 28;
/** Rows in the document beyond those in view, on each side; the window of rows moves by as many as STEP_ROWS. */
const OVERSCAN_ROWS = 8;
const STEP_ROWS = 5;

const keyOf = (line: Line): string =>
  line.kind === "group" ? `g ${line.title}` : line.kind === "robot" ? `r ${line.name}` : `d ${line.index} ${line.name}`;

export function List({ fleet }: { readonly fleet: Fleet }) {
  const box = useRef<HTMLDivElement>(null);
  const isPhone = usePhone();
  const first = useSignal(0);
  const room = useSignal(600);
  const active = useSignal<string | undefined>(undefined);
  const height = isPhone ? PHONE_HEIGHT : ROW_PX;
  const head = isPhone ? 0 : HEAD_PX;

  useLayoutEffect(() => {
    const element = box.current;
    if (!element) return undefined;
    const watch = new ResizeObserver(() => (room.value = element.clientHeight));
    watch.observe(element);
    room.value = element.clientHeight;
    return () => watch.disconnect();
  }, [room]);

  const lines = fleet.lines.value;
  const activeIndex = useComputed(() => fleet.lines.value.findIndex((line) => keyOf(line) === active.value)).value;
  const from = Math.max(0, Math.min(first.value, lines.length - 1));
  const pool = Math.ceil(room.value / height) + 2 * OVERSCAN_ROWS + STEP_ROWS;
  const to = Math.min(lines.length, from + pool);

  const isScrolled = useRef(false);
  const onScroll = (): void => {
    const top = box.current?.scrollTop ?? 0;
    isScrolled.current = top > 0;
    const at = Math.floor(top / height);
    first.value = Math.max(0, Math.floor((at - OVERSCAN_ROWS) / STEP_ROWS) * STEP_ROWS);
    fleet.disturb();
  };
  // a choice of other robots begins at the top
  const { sort, descending, shown, query, grouping } = fleet.place.value;
  useLayoutEffect(() => {
    if (isScrolled.current) box.current?.scrollTo({ top: 0 }); // else it would only cost a layout
  }, [sort, descending, shown, query, grouping]);

  const show = (index: number): void => {
    const element = box.current;
    const line = lines[index];
    if (!element || !line) return;
    active.value = keyOf(line);
    const top = index * height;
    const inside = element.clientHeight - head;
    if (top < element.scrollTop) element.scrollTop = top;
    else if (top + height > element.scrollTop + inside) element.scrollTop = top + height - inside;
  };
  const open = useCallback(
    (name: string, index: number): void => {
      const line = fleet.lines.peek()[index];
      active.value = line && keyOf(line);
      fleet.open(name);
    },
    [fleet, active],
  );
  const expand = useCallback((name: string): void => fleet.toggleDevices(name), [fleet]);
  const fold = useCallback((title: string): void => fleet.toggleFold(title), [fleet]);

  const onKeyDown = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const page = Math.max(1, Math.floor((room.value - head) / height) - 1);
    const moves: Readonly<Record<string, number>> = {
      ArrowDown: activeIndex + 1,
      ArrowUp: Math.max(0, activeIndex - 1),
      PageDown: activeIndex + page,
      PageUp: activeIndex - page,
      Home: 0,
      End: lines.length - 1,
    };
    const move = moves[event.key];
    const line = lines[activeIndex];
    if (move !== undefined) show(Math.max(0, Math.min(lines.length - 1, move)));
    else if (line && act(event.key, line, fleet)) active.value = keyOf(line);
    else return;
    fleet.disturb();
    event.preventDefault();
    event.stopPropagation();
  };

  void fleet.version.value;
  const place = fleet.place.value;
  const now = fleet.now();
  const isInView = activeIndex >= from && activeIndex < to;
  return (
    <div
      ref={box}
      class="fleet-list text-sm"
      data-by={grouping}
      role="grid"
      tabIndex={0}
      aria-label={TEXT.robots}
      aria-rowcount={lines.length + 1}
      aria-activedescendant={isInView ? `fleet-row-${activeIndex}` : undefined}
      onScroll={onScroll}
      onKeyDown={onKeyDown}
    >
      <Head fleet={fleet} />
      <div
        class="fleet-rows"
        role="rowgroup"
        style={{ height: `${lines.length * height}px` }}
        onPointerEnter={(event) => event.pointerType === "mouse" && fleet.pointer(true)}
        onPointerLeave={() => fleet.pointer(false)}
        onPointerDown={() => fleet.disturb()}
      >
        {lines.slice(from, to).map((line, i) => {
          const index = from + i;
          const common = { id: `fleet-row-${index}`, index, isActive: index === activeIndex, top: index * height };
          if (line.kind === "group") {
            return (
              <GroupRow
                key={index % pool}
                {...common}
                line={line}
                fleet={fleet}
                isFolded={fleet.folded.value.has(line.title)}
                onFold={fold}
              />
            );
          }
          const robot = fleet.robots.get(line.name);
          if (!robot) return null;
          const { state, since } = robot.summary;
          const isRobot = line.kind === "robot";
          return (
            <RobotRow
              key={index % pool}
              {...common}
              robot={robot}
              deviceIndex={isRobot ? undefined : line.index}
              lostFor={isRobot && state === "lost" ? ageText(now, since) : ""}
              isOpen={isRobot && place.robot === line.name}
              isExpanded={fleet.expanded.value.has(line.name)}
              hasLeft={!fleet.robots.all.has(line.name)}
              place={place}
              onOpen={open}
              onExpand={expand}
            />
          );
        })}
      </div>
    </div>
  );
}

/** Enter, and the arrows that open and close a row. Returns whether the key did anything. */
function act(key: string, line: Line, fleet: Fleet): boolean {
  if (line.kind === "group") {
    const isFolded = fleet.folded.peek().has(line.title);
    if (key !== "Enter" && key !== (isFolded ? "ArrowRight" : "ArrowLeft")) return false;
    fleet.toggleFold(line.title);
    return true;
  }
  if (key === "Enter") {
    fleet.open(line.name);
    return true;
  }
  const isExpanded = fleet.expanded.peek().has(line.name);
  const devices = fleet.robots.get(line.name)?.summary.devices.length ?? 0;
  if (line.kind !== "robot" || devices < 2 || key !== (isExpanded ? "ArrowLeft" : "ArrowRight")) return false;
  fleet.toggleDevices(line.name);
  return true;
}

function Head({ fleet }: { readonly fleet: Fleet }) {
  const { sort, descending } = fleet.place.value;
  return (
    <div role="row" aria-rowindex={1} class="fleet-head">
      {COLUMNS.map(({ name, title, figures }) => (
        <span
          key={name}
          role="columnheader"
          aria-sort={sort === name ? (descending ? "descending" : "ascending") : "none"}
          data-column={name}
          class={figures ? "num" : ""}
        >
          <button type="button" title={TEXT.sorted(title)} onClick={() => fleet.sortBy(name)}>
            <span class="ellipsis">{title}</span>
            {sort === name && <Icon name={descending ? "down" : "up"} />}
          </button>
        </span>
      ))}
    </div>
  );
}

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
  { name: "alarms", tone: "" },
  { name: "loss", tone: "warn" },
  { name: "fix", tone: "warn" },
  { name: "drifted", tone: "warn" },
];

function GroupRow({ id, index, line, fleet, isActive, isFolded, top, onFold }: Props) {
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
              <span class={`dot ${tone || toneOfAlarms(robots)}`} /> {number(n, 0)}{" "}
              <span class="desk">{TEXT.shown[name].toLowerCase()}</span>
            </span>
          );
        })}
      </span>
    </div>
  );
}
