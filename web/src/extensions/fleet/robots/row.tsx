/** One line of the list. A row is drawn again only if what it shows has changed. */
import { Component, type JSX } from "preact";
import { Button } from "../../../ui/controls/button";
import { age } from "../../../ui/format/format";
import { Icon } from "../../../ui/controls/icons";
import { type RobotCell, cellOf, COLUMNS, type RobotColumn, deviceCell, stateWord } from "./columns";
import { fleetHref, type FleetPlace } from "./address";
import type { RobotDevice } from "../../../wire/routes";
import type { Robot } from "./robots";
import { robotHref } from "../../../requests/server-place";
import { rowProperties } from "./roles";
import { TEXT } from "./texts";

export interface RowProps {
  readonly id: string;
  /** Number of the line in the list, from 0. */
  readonly index: number;
  readonly robot: Robot;
  /** One of its devices; undefined: the robot. */
  readonly deviceIndex?: number | undefined;
  /** How long it is lost, "12 min". */
  readonly lostFor: string;
  readonly isActive: boolean;
  readonly isOpen: boolean;
  readonly isExpanded: boolean;
  readonly hasLeft: boolean;
  readonly place: FleetPlace;
  readonly top: number;
  readonly onOpen: (name: string, index: number) => void;
  readonly onExpand: (name: string) => void;
}

const FIGURES = new Set(COLUMNS.filter(({ figures }) => figures).map(({ name }) => name));
const OF_DEVICE = new Set<RobotColumn>(["rate", "loss", "fix", "temperature", "clock", "firmware"]);

export class RobotRow extends Component<RowProps> {
  override shouldComponentUpdate(next: Readonly<RowProps>): boolean {
    const now = this.props;
    for (const name in next) {
      // the place is for the link only, which a click does not follow
      if (name !== "place" && next[name as keyof RowProps] !== now[name as keyof RowProps]) return true;
    }
    return false;
  }

  override render({ id, index, robot, deviceIndex, isActive, isOpen, top, hasLeft, onOpen }: RowProps): JSX.Element {
    const { name, state } = robot.summary;
    const isHeld = state === "lost" || hasLeft;
    const open = (event: MouseEvent): void => {
      if (event.ctrlKey || event.metaKey || event.shiftKey) return; // a link of its own
      event.preventDefault();
      onOpen(name, index);
    };
    return (
      <div
        {...rowProperties({ id, index, top }, { "aria-selected": isOpen }, open)}
        class={`fleet-row ${deviceIndex === undefined ? "" : "of-device"} ${isActive ? "active" : ""} ${isOpen ? "on" : ""} ${isHeld ? "held" : ""}`}
      >
        {deviceIndex === undefined ? this.#robotCells() : this.#deviceCells(deviceIndex)}
      </div>
    );
  }

  #robotCells(): JSX.Element[] {
    const { robot } = this.props;
    return COLUMNS.map(({ name }) => {
      if (name === "name") return this.#name();
      if (name === "state") return this.#state();
      if (name === "device") return this.#device();
      if (name === "recording") {
        return (
          <span key={name} role="gridcell" data-column="recording">
            {robot.summary.recording && (
              <>
                <i class="record-dot" />
                <span class="visually-hidden">{TEXT.recordingOn}</span>
              </>
            )}
          </span>
        );
      }
      return figure(name, cellOf(name, robot));
    });
  }

  #deviceCells(index: number): JSX.Element[] {
    const device = this.props.robot.summary.devices[index];
    return COLUMNS.map(({ name }) => {
      if (device && name === "device") {
        return (
          <span key={name} role="gridcell" data-column="device">
            <DeviceName device={device} />
          </span>
        );
      }
      if (device && name === "state") {
        return (
          <span key={name} role="gridcell" data-column="state" class="dim">
            {device.status}
          </span>
        );
      }
      return figure(name, device && OF_DEVICE.has(name) ? deviceCell(name, device) : { text: "" });
    });
  }

  #name(): JSX.Element {
    const { robot, place } = this.props;
    const { name, group, pages, state } = robot.summary;
    return (
      <span key="name" role="gridcell" data-column="name">
        <a class="ellipsis" tabIndex={-1} href={fleetHref({ ...place, robot: name })}>
          {name}
        </a>
        {group !== "" && <small class="ellipsis">{group}</small>}
        {pages !== "off" && state === "live" && (
          <a
            class="open-robot"
            tabIndex={-1}
            href={robotHref(name)}
            aria-label={TEXT.openRobot(name)}
            title={TEXT.openRobot(name)}
            onClick={(event) => event.stopPropagation()}
          >
            <Icon name="forward" />
          </a>
        )}
      </span>
    );
  }

  #state(): JSX.Element {
    const { robot, lostFor, hasLeft } = this.props;
    const { tone, conditions } = robot.health;
    return (
      <span key="state" role="gridcell" data-column="state">
        <span class={`dot ${hasLeft ? "off" : (tone ?? "live")}`} />
        <span class="ellipsis">{hasLeft ? TEXT.left : stateWord(robot)}</span>
        {lostFor !== "" && <small>{lostFor}</small>}
        {conditions.length > 1 && <small>{TEXT.moreDevices(conditions.length - 1)}</small>}
      </span>
    );
  }

  #device(): JSX.Element {
    const { robot, isExpanded, onExpand } = this.props;
    const { name, devices } = robot.summary;
    const more = devices.length - 1;
    return (
      <span key="device" role="gridcell" data-column="device">
        <DeviceName device={robot.device} />
        {more > 0 && (
          <Button
            look="small more-devices"
            tabIndex={-1}
            aria-expanded={isExpanded}
            aria-label={isExpanded ? TEXT.hideDevices(devices.length, name) : TEXT.showDevices(devices.length, name)}
            onClick={(event) => {
              event.stopPropagation();
              onExpand(name);
            }}
          >
            {TEXT.moreDevices(more)}
            <Icon name={isExpanded ? "up" : "down"} />
          </Button>
        )}
      </span>
    );
  }
}

/** The product may be cut short, the serial number not. */
function DeviceName({ device }: { readonly device: RobotDevice | undefined }) {
  if (!device) return <span class="dim">—</span>;
  return (
    <>
      <span class="ellipsis">{device.product || device.name}</span>
      <span class="serial">{device.serial_number}</span>
    </>
  );
}

/** Plain text in the cell itself: of these there are many, and each further element costs time to lay out. */
function figure(name: RobotColumn, { text, unit, more, tone, isQuiet }: RobotCell): JSX.Element {
  const content = (
    <>
      {text}
      {unit !== undefined && unit !== "" && <span class="unit">{unit}</span>}
      {more !== undefined && <small> {more}</small>}
    </>
  );
  return (
    <span
      key={name}
      role="gridcell"
      data-column={name}
      class={`ellipsis ${FIGURES.has(name) ? "num" : ""} ${isQuiet ? "dim" : ""}`}
    >
      {tone === undefined ? content : <span class={`told ${tone}`}>{content}</span>}
    </span>
  );
}

/** "12 min" since a unix time. */
export function ageText(now: number, since: number): string {
  const { value, unit } = age(Math.max(1, now - since));
  return TEXT.since(value, unit);
}
