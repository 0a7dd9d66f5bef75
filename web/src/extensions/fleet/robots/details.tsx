/** Everything known of one robot: beside the list, or over it on a phone. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { number, clock } from "../../../ui/format/format";
import { robotHref } from "../../../requests/server-place";
import { IconButton } from "../../../ui/controls/icon-button";
import {
  type RobotCell,
  clockCell,
  diskCell,
  fixCell,
  latencyCell,
  lossCell,
  rateCell,
  settingsCell,
  temperatureCell,
} from "./columns";
import type { Fleet } from "./fleet-state";
import type { Robot } from "./robots";
import { ageText } from "./row";
import { SettingsCheck } from "./settings";
import type { RobotDevice, RobotSummary, FleetEvent, RobotAlarm } from "../../../wire/routes";
import { TEXT } from "./texts";
import { useSignal } from "@preact/signals";
import { dayWords } from "../../../recordings/library-filter";
import { Button } from "../../../ui/controls/button";
import { type HttpProblem, request } from "../../../requests/http";
import { ProblemNote } from "../../../requests/problem-note";
import { PersonForm } from "./person-form";
import "./details.css";

export function RobotDetails({ fleet }: { readonly fleet: Fleet }) {
  const { robot: name } = fleet.place.value;
  const heading = useRef<HTMLHeadingElement>(null);
  void fleet.version.value;
  const robot = fleet.robots.get(name);
  useEffect(() => {
    // on a phone the details cover the list
    if (matchMedia("(max-width: 1119px)").matches) heading.current?.focus();
  }, [name]);
  useEffect(() => {
    const onKey = (event: KeyboardEvent): void => {
      if (event.key !== "Escape" || event.defaultPrevented || document.querySelector("dialog[open]")) return;
      event.preventDefault();
      fleet.open("");
    };
    addEventListener("keydown", onKey);
    return () => {
      removeEventListener("keydown", onKey);
      document.querySelector<HTMLElement>(".fleet-list, .fleet-map")?.focus({ preventScroll: true });
    };
  }, [fleet]);
  return (
    <aside class="fleet-details text-sm" aria-label={TEXT.details}>
      <div class="head">
        <h2 ref={heading} tabIndex={-1} class="ellipsis">
          {name}
        </h2>
        <span class="grow" />
        <IconButton icon="close" label={TEXT.closeDetails} onClick={() => fleet.open("")} />
      </div>
      {robot ? <Known robot={robot} fleet={fleet} /> : <p class="dim padded">{TEXT.noDetails}</p>}
    </aside>
  );
}

function Known({ robot, fleet }: { readonly robot: Robot; readonly fleet: Fleet }) {
  const { summary, health } = robot;
  const isLost = summary.state === "lost";
  const recording: RobotCell = { text: summary.recording ? TEXT.recordingOn : TEXT.recordingOff };
  return (
    <div class={`detail ${isLost ? "held" : ""}`}>
      <p class="fleet-needs flex-wrap" role="group" aria-label={TEXT.needs}>
        {health.conditions.length === 0 && (
          <span class="tag">
            <span class="dot live" /> {TEXT.healthy}
          </span>
        )}
        {health.conditions.map((name, i) => (
          <span key={name} class={`tag ${i === 0 ? (health.tone ?? "") : ""}`}>
            {TEXT.conditions[name]}
          </span>
        ))}
      </p>
      {summary.same_name > 0 && <p>{TEXT.sameName(summary.same_name)}</p>}
      {isLost && <p class="dim">{TEXT.figuresFrom}</p>}
      <dl class="fact-list">
        <Fact title={isLost ? TEXT.whenLost : TEXT.whenLive} cell={{ text: ageText(fleet.now(), summary.since) }} />
        {summary.group !== "" && <Fact title={TEXT.group} cell={{ text: summary.group }} />}
        <Fact
          title={TEXT.settings}
          cell={summary.settings === "unknown" ? { text: TEXT.unknownSettings } : settingsCell(robot)}
        />
        <Fact title={TEXT.recording} cell={recording} />
        <Fact title={TEXT.disk} cell={diskCell(robot)} />
        <Fact title={TEXT.latency} cell={latencyCell(robot)} />
        <Fact title={TEXT.version} cell={{ text: summary.version || "—" }} />
      </dl>
      {Object.keys(summary.more).length > 0 && (
        <>
          <h3>{TEXT.alsoReported}</h3>
          <dl class="fact-list">
            <Further more={summary.more} />
          </dl>
        </>
      )}
      <h3>{TEXT.ownPages}</h3>
      <OwnPages summary={summary} />
      <h3>{TEXT.alarms}</h3>
      <Alarms key={`alarms ${summary.name}`} robot={summary} fleet={fleet} />
      <SettingsCheck key={`settings ${summary.name}`} robot={summary} fleet={fleet} />
      <RobotEvents key={summary.name} name={summary.name} />
      <h3>{TEXT.devices}</h3>
      {summary.devices.length === 0 && <p class="dim">{TEXT.noDevice}</p>}
      {summary.devices.map((device) => (
        <Device key={device.id} device={device} isLost={isLost} />
      ))}
      {isLost && <RemoveRobot key={`remove ${summary.name}`} name={summary.name} fleet={fleet} />}
    </div>
  );
}

/** Only pages of the web: an address comes from a robot. */
function webAddress(address: string): string | undefined {
  try {
    const url = new URL(address);
    return url.protocol === "http:" || url.protocol === "https:"
      ? url.href.replace(/[#?].*$/, "").replace(/\/$/, "")
      : undefined;
  } catch {
    return undefined;
  }
}

/** Through the fleet server if the robot allows it, and at its own address if it published one. */
function OwnPages({ summary: { name, address, pages, state } }: { readonly summary: RobotSummary }) {
  const at = webAddress(address);
  const isOff = pages === "off";
  const links = [
    ["", TEXT.openLive],
    ["configure", TEXT.openConfigure],
    ["recordings", TEXT.openRecordings],
  ] as const;
  return (
    <>
      {!isOff && (
        <div class="fleet-links">
          {links.map(([page, title]) => (
            <a key={page} class="btn edge" href={robotHref(name, page)}>
              {title}
            </a>
          ))}
        </div>
      )}
      {isOff && <p class="dim">{TEXT.pagesOff}</p>}
      {pages === "view" && <p class="dim">{TEXT.pagesView}</p>}
      {at !== undefined && (
        <a class="btn own-address" href={`${at}/`} target="_blank" rel="noopener noreferrer">
          {TEXT.atOwnAddress}
        </a>
      )}
      {state === "lost" && <p class="dim">{TEXT.unreachableHint}</p>}
    </>
  );
}

function dotOf({ status }: RobotDevice): string {
  return status === "live" ? "live" : status === "lost" || status === "denied" ? "bad" : "off";
}

/** @param isLost the robot is: what its device was does not count */
function Device({ device, isLost }: { readonly device: RobotDevice; readonly isLost: boolean }) {
  const { clock_uncertainty_ms: uncertainty } = device;
  const expected = device.expected_rate;
  const text = (value: string): RobotCell => ({ text: value || "—" });
  return (
    <section class="fleet-device">
      <h4>
        <span class={`dot ${isLost ? "off" : dotOf(device)}`} />
        <span class="ellipsis">{device.name || device.product}</span>
        {!isLost && <span class="dim">{device.status}</span>}
      </h4>
      <dl class="fact-list">
        {device.product !== "" && device.product !== device.name && (
          <Fact title={TEXT.product} cell={text(device.product)} />
        )}
        <Fact title={TEXT.serialNumber} cell={text(device.serial_number)} />
        <Fact title={TEXT.firmware} cell={text(device.firmware)} />
        <Fact title={TEXT.protocol} cell={text(device.protocol)} />
        <Fact
          title={TEXT.rate}
          cell={{ ...rateCell(device), more: expected === null ? "" : TEXT.ofRate(`${number(expected, 0)} Hz`) }}
        />
        <Fact title={TEXT.lossLastMinute} cell={lossCell(device.loss)} />
        <Fact title={TEXT.lostSinceStart} cell={{ text: number(device.lost, 0), unit: TEXT.samples(device.lost) }} />
        {device.fix !== "" && <Fact title={TEXT.fix} cell={fixCell(device)} />}
        <Fact title={TEXT.temperature} cell={temperatureCell(device)} />
        <Fact title={TEXT.clockRate} cell={clockCell({ ...device, clock_uncertainty_ms: null })} />
        {uncertainty !== null && (
          <Fact title={TEXT.clockUncertainty} cell={clockCell({ ...device, clock_ppm: null })} />
        )}
        <Further more={device.more} />
      </dl>
    </section>
  );
}

/** What a robot of a later version reports, as it is. */
function Further({ more }: { readonly more: Readonly<Record<string, string>> }) {
  return (
    <>
      {Object.entries(more).map(([name, text]) => (
        <Fact key={name} title={name} cell={{ text }} />
      ))}
    </>
  );
}

function Fact({
  title,
  cell: { text, unit, more, tone },
}: {
  readonly title: string;
  readonly cell: RobotCell;
}): ComponentChildren {
  return (
    <div>
      <dt>{title}</dt>
      <dd class={tone ?? ""}>
        {text}
        {unit !== undefined && unit !== "" && <span class="unit">{unit}</span>}
        {more !== undefined && more !== "" && <small class="dim"> {more}</small>}
      </dd>
    </div>
  );
}

/** How many events of a robot are shown. */
const MAX_EVENTS = 30;

function RobotEvents({ name }: { readonly name: string }) {
  const events = useSignal<readonly FleetEvent[] | undefined>(undefined);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const load = async (): Promise<void> => {
    const outcome = await request("GET /api/fleet/events", { query: { robot: name, limit: MAX_EVENTS } });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) events.value = outcome.value;
  };
  return (
    <details class="fleet-events" onToggle={(event) => event.currentTarget.open && void load()}>
      <summary>{TEXT.events}</summary>
      {problem.value && <ProblemNote problem={problem.value} />}
      {events.value?.length === 0 && <p class="dim">{TEXT.noEvent}</p>}
      <ul>
        {events.value?.map(({ id, time, level, text }) => (
          <li key={id}>
            <span class={`dot ${level === "error" ? "bad" : level === "info" ? "off" : "warn"}`} />
            <span>{text}</span>
            <time class="dim" dateTime={new Date(time * 1000).toISOString()}>
              {dayWords(time)} {clock(time)}
            </time>
          </li>
        ))}
      </ul>
    </details>
  );
}

function RemoveRobot({ name, fleet }: { readonly name: string; readonly fleet: Fleet }) {
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const remove = async (): Promise<void> => {
    const outcome = await request("DELETE /api/fleet/robots/{robot}", { path: { robot: name } });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) return;
    fleet.open("");
    fleet.retry();
  };
  return (
    <>
      <p class="dim">{TEXT.removeHint}</p>
      <Button changes look="edge" words={TEXT.remove} onClick={() => void remove()} />
      {problem.value && <ProblemNote problem={problem.value} />}
    </>
  );
}

function Alarms({ robot, fleet }: { readonly robot: RobotSummary; readonly fleet: Fleet }) {
  const asking = useSignal("");
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const send = async (by: string): Promise<void> => {
    const outcome = await request("POST /api/fleet/robots/{robot}/acknowledge", {
      path: { robot: robot.name },
      body: { condition: asking.peek(), by },
    });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) return;
    asking.value = "";
    fleet.retry();
  };
  if (robot.alarms.length === 0) return <p class="dim">{TEXT.noAlarm}</p>;
  return (
    <>
      <ul class="fleet-alarms">
        {robot.alarms.map((alarm) => (
          <Row
            key={`${alarm.condition} ${alarm.name} ${alarm.device}`}
            alarm={alarm}
            robot={robot}
            ask={() => (asking.value = alarm.condition)}
          />
        ))}
      </ul>
      {asking.value !== "" && <PersonForm title={TEXT.acknowledge} send={send} cancel={() => (asking.value = "")} />}
      {problem.value && <ProblemNote problem={problem.value} />}
    </>
  );
}

interface RowProps {
  readonly alarm: RobotAlarm;
  readonly robot: RobotSummary;
  readonly ask: () => void;
}

function Row({ alarm: { name, level, state, device, condition, acknowledged_by: by }, robot, ask }: RowProps) {
  const of = robot.devices.find(({ id }) => id === device);
  return (
    <li>
      <span class={`dot ${state === "acknowledged" ? "off" : level === "error" ? "bad" : "warn"}`} />
      <span>
        {name} <span class="dim">{of && TEXT.alarmOf(of.name || of.product)}</span>
      </span>
      {condition !== "" && state === "raised" ? (
        <Button
          changes
          look="small edge"
          words={TEXT.acknowledge}
          onClick={ask}
          aria-label={TEXT.acknowledgeAlarm(name)}
        />
      ) : (
        <span class="mid">{by === "" ? TEXT.alarmState(state) : TEXT.acknowledgedBy(by)}</span>
      )}
    </li>
  );
}
