/** Which sensors are there? The devices with their state, and what else was heard on this host. */
import { signal } from "@preact/signals";
import { view } from "../data/view-state";
import { recently } from "../panels/panel-context";
import { rateBars } from "../panels/health-history";
import { drawBars } from "../panels/sparkline";
import { keyWanted, trustOf } from "../panels/authenticity";
import { api, type Port } from "../ui/http";
import { surface } from "../ui/canvas";
import { el, every, type Panel } from "../ui/dom";
import { age, count, rate } from "../ui/format";
import { Icon } from "../ui/icons";
import { Message } from "../ui/message";
import { Mounted } from "../ui/panel-host";
import { markOf, shortSource } from "../ui/page-state";
import type { DeviceHealth, DeviceInfo } from "../wire/types";
import { type App, askKey, connect, linkOf, overlay, ports, run, scanning, scanPorts, select, sheet, tick } from "./app-state";

/** The device whose removal was asked for once; asking twice removes it. */
const removing = signal<string | undefined>(undefined);

export function Rail({ app }: { readonly app: App }) {
  const devices = app.store.devices.value;
  const inUse = new Set(devices.map((device) => shortSource(device.source)));
  const others = ports.value.filter((port) => !inUse.has(shortSource(port.device)));
  return (
    <aside class={`rail ${sheet.value === "rail" ? "open" : ""}`} id="rail" aria-label="Devices">
      <div class="head">
        <h2>Devices</h2>
        <span>{devices.length}</span>
        <span class="grow" />
        <button type="button" class="btn icon" aria-label="Add a device" title="Add a device by its address" onClick={() => (overlay.value = "add")}>
          <Icon name="plus" />
        </button>
        {sheet.value === "rail" && (
          <button type="button" class="btn icon" aria-label="Close the list of devices" onClick={() => (sheet.value = undefined)}>
            <Icon name="close" />
          </button>
        )}
      </div>
      {devices.length > 0 && (
        <ul class="devs">
          {inOrder(devices).map((device) => (
            <Device key={device.id} app={app} device={device} shared={devices.filter((one) => linkOf(one) === linkOf(device)).length} />
          ))}
        </ul>
      )}
      <div class="head also">
        <h3>Also on this host</h3>
        <span class="grow" />
        <button type="button" class="btn small" disabled={scanning.value} onClick={() => void scanPorts()}>
          {scanning.value ? "Listening…" : "Scan"}
        </button>
      </div>
      {others.length === 0 ? <p class="foot-note dim">No other serial port.</p> : null}
      <ul>
        {others.map((port) => (
          <Ghost key={port.device} port={port} />
        ))}
      </ul>
    </aside>
  );
}

/** As the server lists them, but those on one link below each other. */
export function inOrder(devices: readonly DeviceInfo[]): readonly DeviceInfo[] {
  return devices.filter(({ parent }) => parent === "").flatMap((own) => [own, ...devices.filter(({ parent }) => parent === own.id)]);
}

interface DeviceProps {
  readonly app: App;
  readonly device: DeviceInfo;
  /** How many devices are on its link. */
  readonly shared: number;
}

function Device({ app, device, shared }: DeviceProps) {
  const current = view.value.device === device.id;
  const health = app.store.health.value.get(device.id);
  const { gaps } = recently(app, device.id);
  const { dot, word } = markOf(device.status, gaps);
  const streams = device.status === "live" && !app.store.isCut;
  return (
    <li class={device.parent ? "dev sibling" : "dev"} {...(current ? { "aria-current": "true" as const } : {})}>
      <button type="button" class="pick" aria-pressed={current} onClick={() => select(device.id)}>
        <span class={`dot ${dot}`} />
        <span class="vh">{word}: </span>
        <b class="ell">{device.name}</b>
        <span class="rate">
          {streams && health ? rate(health.rate) : "—"}
          <span class="u">Hz</span>
        </span>
        <Facts device={device} />
        <TrustTag device={device} health={health} />
        {(streams || app.minute.of(device.id).some((moment) => moment.rate > 0)) && <Mounted key={device.id} class="spark" mount={(host) => mountSpark(host, app, device.id)} />}
        <Why app={app} device={device} health={health} gaps={gaps} />
      </button>
      {current && <Acts device={device} shared={shared} />}
    </li>
  );
}

function Facts({ device }: { readonly device: DeviceInfo }) {
  return (
    <span class="facts">
      <span title={unreadHint(device)}>{productWords(device)}</span>
      <br />
      {device.serial_number !== "" && (
        <>
          <span class="nb">
            S/N <span class="mono">{device.serial_number}</span>
          </span>
          {" · "}
        </>
      )}
      <span class="nb" title={device.source}>
        {device.parent ? "same link" : shortSource(device.source)}
      </span>
      {device.baud !== null && device.parent === "" && (
        <>
          {" · "}
          <span class="nb">{count(device.baud, "Bd", "Bd")}</span>
        </>
      )}
    </span>
  );
}

/** Verified or not, with what protects the frames; nothing where a protocol does not tell. */
function TrustTag({ device, health }: { readonly device: DeviceInfo; readonly health: DeviceHealth | undefined }) {
  const trust = trustOf(device, health);
  if (!trust) return null;
  return (
    <span class="trust" data-trust={trust.word}>
      <span class={trust.tone ? `tag ${trust.tone}` : ""}>
        {trust.mark} {trust.word}
      </span>
      {trust.detail && ` ${trust.tone ? "" : "· "}${trust.detail}`}
    </span>
  );
}

/** Protocols by the names their documents use. */
const PROTOCOLS: Readonly<Record<string, string>> = { xbus: "Xbus", isb: "ISB", idtp: "IDTP" };

/** What is known of the product beyond the name above it. */
function productWords(device: DeviceInfo): string {
  const { name, product, protocol, firmware } = device;
  if (protocol === "") return "nothing known yet";
  const said = product === name ? "" : product || (unreadHint(device) ? "product unknown until read" : "product unknown");
  return [said, PROTOCOLS[protocol] ?? protocol, firmware && `firmware ${firmware}`].filter(Boolean).join(" · ");
}

/** Why an MTi has no name yet, and what helps. */
function unreadHint({ protocol, product, link }: DeviceInfo): string | undefined {
  if (protocol !== "xbus" || product !== "" || link === "file") return undefined;
  return "An MTi does not say what it is while it measures: reading its settings stops it for about a second and asks it.";
}

interface WhyProps {
  readonly app: App;
  readonly device: DeviceInfo;
  readonly health: DeviceHealth | undefined;
  readonly gaps: number;
}

/** The line that says why a device wants to be looked at; nothing while all is well. */
function Why({ app, device, health, gaps }: WhyProps) {
  if (device.status === "live") {
    if (gaps === 0) return null;
    return (
      <span class="why">
        <span class="tag warn">{count(gaps, "gap")}</span>in the last minute
      </span>
    );
  }
  void tick.value;
  const now = app.store.serverNow();
  const last = health?.last_arrival ?? device.last_arrival;
  const ago = last === null || last === undefined ? "" : `${age(now - last).value} ${age(now - last).unit} ago`;
  const left = device.next_try === null ? 0 : Math.ceil(device.next_try - now);
  const next = left > 0 ? `next try ${left} s` : "";
  const words = [ago, next].filter(Boolean).join(" · ");
  const [tone, name] = WANTS[device.wants] ?? NAMES[device.status];
  const wanted = device.status === "connecting" && keyWanted(health) !== ""; // it is heard, and refused
  return (
    <span class="why">
      <span class={`tag ${wanted ? "warn" : tone}`}>{wanted ? "Key missing" : name}</span>
      {device.status === "connecting" && next === "" ? (device.tries.at(-1)?.what ?? "") : words}
    </span>
  );
}

/** What a device waits for while bytes come and nothing of them can be shown. */
const WANTS: Readonly<Partial<Record<DeviceInfo["wants"], readonly [string, string]>>> = {
  key: ["warn", "Key missing"],
  rearm: ["warn", "Restarted"],
};

const NAMES: Readonly<Record<Exclude<DeviceInfo["status"], "live">, readonly [string, string]>> = {
  connecting: ["", "Connecting"],
  lost: ["bad", "Lost"],
  denied: ["bad", "Not permitted"],
  idle: ["", "Idle"],
  ended: ["", "Ended"],
};

function Acts({ device, shared }: { readonly device: DeviceInfo; readonly shared: number }) {
  if (removing.value === device.id) {
    const remove = (): void => {
      removing.value = undefined;
      void run(api.removeDevice(linkOf(device)));
    };
    return (
      <div class="acts">
        <span class="grow">{shared > 1 ? `Remove all ${shared} devices of this link?` : `Remove ${device.name}?`}</span>
        <button type="button" class="btn small edge" onClick={remove}>
          Remove
        </button>
        <button type="button" class="btn small" onClick={() => (removing.value = undefined)}>
          Keep
        </button>
      </div>
    );
  }
  return (
    <div class="acts">
      {device.status !== "live" && (
        <button type="button" class="btn small edge" onClick={() => void run(api.retryDevice(linkOf(device)))}>
          {device.status === "ended" ? "Play again" : "Try now"}
        </button>
      )}
      {device.protocol === "idtp" && (
        <button type="button" class="btn small" onClick={() => askKey(device)}>
          Reading…
        </button>
      )}
      <span class="grow" />
      <button type="button" class="btn small" onClick={() => (removing.value = device.id)}>
        {shared > 1 ? "Remove the link" : "Remove"}
      </button>
    </div>
  );
}

function mountSpark(host: HTMLElement, app: App, id: string): Panel {
  const canvas = el("canvas", { role: "img", "aria-label": "Samples per second, last minute" });
  host.append(canvas);
  const due = every(2);
  let redraw = true;
  const to = surface(canvas, () => {
    redraw = true;
  });
  return {
    update(now) {
      if (!due(now) && !redraw) return;
      redraw = false;
      const gone = app.store.devices.peek().find((device) => device.id === id)?.status === "lost";
      drawBars(to, rateBars(app.minute.of(id), app.store.serverNow(), 60), gone);
    },
    dispose() {
      to.dispose();
      canvas.remove();
    },
  };
}

/** A port that no device uses: what was heard there, and a way to connect to it. */
function Ghost({ port }: { readonly port: Port }) {
  const free = port.busy === "" && port.denied === "";
  return (
    <li class="dev ghost">
      <div class="pick">
        <span class="dot off" />
        <b class="ell">{shortSource(port.device)}</b>
        {free ? (
          <button type="button" class="btn small edge" aria-label={`Connect to ${shortSource(port.device)}`} onClick={() => void connect(port.device)}>
            Connect
          </button>
        ) : (
          <span />
        )}
        <span class="facts"><Message text={portWords(port)} /></span>
      </div>
    </li>
  );
}

/** One line about a port: why it cannot be opened, else what was heard, else what it is. */
export function portWords(port: Port): string {
  if (port.denied !== "") return port.denied;
  if (port.busy !== "") return `In use by ${port.busy}.`;
  const last = port.heard.at(-1);
  return last ? `${last.what}: ${last.outcome}` : `${port.description}. Not listened to yet.`;
}
