/** The devices with their state, and other ports of this host with data. */
import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Slot } from "../extension/extension";
import { recently } from "../panels/panel-context";
import { rateBars } from "../data/health-history";
import { drawBars } from "../panels/sparkline";
import { keyWanted, trustOf } from "../panels/authenticity";
import { Button } from "../ui/controls/button";
import { api, type Port } from "../requests/http";
import { surface } from "../ui/dom/canvas";
import { behindCause, behindHint } from "../panels/behind-text";
import { el, throttle, type Panel } from "../ui/dom/dom";
import { age, clock, rate } from "../ui/format/format";
import { IconButton } from "../ui/controls/icon-button";
import { Message } from "../ui/controls/message";
import { PanelHost } from "../panels/panel-host";
import { markOf, shortSource } from "../page/page-state";
import { fullName, shortName } from "../wire/device-name";
import { MESSAGES, protocolOf } from "../wire/capabilities";
import type { DeviceHealth, DeviceInfo } from "../wire/types";
import { ResumeButton } from "./empty-states";
import { askKey, connect, linkOf, run, scanPorts, select } from "../page/app-state";
import type { App, DeviceActionProps } from "../page/context";
import { SimulatedTag } from "../ui/controls/simulated-tag";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";

declare module "../extension/extension" {
  interface Slots {
    /** Actions of the selected device. */
    readonly deviceActions: DeviceActionProps;
    /** In the row of a device, under its facts. */
    readonly deviceRow: DeviceActionProps;
  }
}

export function Rail({ app }: { readonly app: App }) {
  const { overlay, ports, scanning, sheet } = app;
  const removing = useSignal<string | undefined>(undefined);
  const devices = app.store.devices.value;
  const inUse = new Set(devices.map((device) => shortSource(device.source)));
  const others = ports.value.filter((port) => !inUse.has(shortSource(port.device)));
  return (
    <aside class={`rail ${sheet.value === "rail" ? "open" : ""}`} id="rail" aria-label={COMMON.devices}>
      <div class="head">
        <h2>{COMMON.devices}</h2>
        <span>{devices.length}</span>
        <span class="grow" />
        <IconButton
          changes
          icon="plus"
          label={COMMON.addADevice}
          title={TEXT.addDeviceByAddress}
          onClick={() => (overlay.value = "add")}
        />
        {sheet.value === "rail" && (
          <IconButton icon="close" label={TEXT.closeDeviceList} onClick={() => (sheet.value = undefined)} />
        )}
      </div>
      {devices.length > 0 && (
        <ul class="device-list">
          {inOrder(devices).map((device) => (
            <Device
              key={device.id}
              app={app}
              device={device}
              removing={removing}
              shared={devices.filter((one) => linkOf(one) === linkOf(device)).length}
            />
          ))}
        </ul>
      )}
      <div class="head further">
        <h3>{TEXT.otherSerialPorts}</h3>
        <span class="grow" />
        <Button
          changes
          look="small"
          words={scanning.value ? TEXT.listening : TEXT.scan}
          disabled={scanning.value}
          onClick={() => void scanPorts(app)}
        />
      </div>
      {others.length === 0 ? <p class="foot-note dim">{TEXT.noOtherSerialPort}</p> : null}
      <ul>
        {others.map((port) => (
          <Ghost key={port.device} app={app} port={port} />
        ))}
      </ul>
    </aside>
  );
}

/** In the server's order, with those on one link together. */
function inOrder(devices: readonly DeviceInfo[]): readonly DeviceInfo[] {
  return devices
    .filter(({ parent }) => parent === "")
    .flatMap((own) => [own, ...devices.filter(({ parent }) => parent === own.id)]);
}

interface DeviceProps {
  readonly app: App;
  readonly device: DeviceInfo;
  /** Number of devices on its link. */
  readonly shared: number;
  /** The device whose removal was requested once; the second request removes it. */
  readonly removing: Signal<string | undefined>;
}

function Device({ app, device, shared, removing }: DeviceProps) {
  const current = app.viewState.device.value === device.id;
  const health = app.store.health.value.get(device.id);
  const { gaps } = recently(app, device.id);
  const { dot, word } = markOf(device.status, gaps);
  const streams = device.status === "live" && !app.store.isCut;
  return (
    <li class={device.parent ? "device sibling" : "device"} {...(current ? { "aria-current": "true" as const } : {})}>
      <button type="button" class="choose-device" aria-pressed={current} onClick={() => select(app, device.id)}>
        <span class={`dot ${dot}`} />
        <span class="visually-hidden">{word}: </span>
        <b class="ellipsis">{shortName(device)}</b>
        <span class="rate">
          {streams && health ? rate(health.rate) : "—"}
          <span class="unit">Hz</span>
        </span>
        <Facts device={device} />
        <TrustTag device={device} health={health} />
        {(streams || app.recentHealth.of(device.id).some((moment) => moment.rate > 0)) && (
          <PanelHost key={device.id} class="sparkline" mount={(host) => mountSpark(host, app, device.id)} />
        )}
        <Slot name="deviceRow" with={{ app, device }} />
        <Why app={app} device={device} health={health} gaps={gaps} />
      </button>
      {current && <Acts app={app} device={device} shared={shared} removing={removing} />}
    </li>
  );
}

function Facts({ device }: { readonly device: DeviceInfo }) {
  return (
    <span class="facts">
      <span title={unreadHint(device)}>{productWords(device)}</span>
      <span class="dotted">
        {device.serial_number !== "" && (
          <span>
            S/N <span class="mono">{device.serial_number}</span>
            {device.unconfirmed_since !== null && " "}
            {device.unconfirmed_since !== null && (
              <span class="tag warn" title={TEXT.maybeAnother}>
                {TEXT.notConfirmedSince(clock(device.unconfirmed_since))}
              </span>
            )}
          </span>
        )}
        <span title={device.source}>{device.parent ? TEXT.sameLink : shortSource(device.source)}</span>
        {device.baud !== null && device.parent === "" && <span>{TEXT.baudRate(device.baud)}</span>}
        {device.simulated && (
          <span>
            <SimulatedTag of={device} />
          </span>
        )}
      </span>
    </span>
  );
}

/** Verification state, with the frames' protection; absent if the protocol does not report it. */
function TrustTag({ device, health }: { readonly device: DeviceInfo; readonly health: DeviceHealth | undefined }) {
  const trust = trustOf(device, health);
  if (!trust) return null;
  return (
    <span class="trust" data-trust={trust.state}>
      <span class={trust.tone ? `tag ${trust.tone}` : ""}>
        {trust.mark} {trust.word}
      </span>
      {trust.detail && ` ${trust.tone ? "" : "· "}${trust.detail}`}
    </span>
  );
}

/** Product details beyond the name above. */
function productWords(device: DeviceInfo): string {
  const { name, product, protocol, firmware, own_name: own } = device;
  if (protocol === "") return TEXT.protocolUnknown;
  if (protocol === MESSAGES) return TEXT.messages;
  const said =
    product === name && own === ""
      ? ""
      : product || (unreadHint(device) ? TEXT.productUnknownUntilRead : TEXT.productUnknown);
  return [said, protocolOf(protocol)?.short ?? protocol, firmware && COMMON.firmware(firmware)]
    .filter(Boolean)
    .join(" · ");
}

/** Why a device has no name yet, and what helps; "" for nothing. */
function unreadHint({ protocol, product, link }: DeviceInfo): string {
  return product !== "" || link === "file" ? "" : (protocolOf(protocol)?.identify_hint ?? "");
}

interface WhyProps {
  readonly app: App;
  readonly device: DeviceInfo;
  readonly health: DeviceHealth | undefined;
  readonly gaps: number;
}

/** The line that says why a device needs attention; absent while all is well. */
function Why({ app, device, health, gaps }: WhyProps) {
  if (device.status === "live") {
    const behind = app.store.behind(device.id);
    if (behind.total > 0) {
      const { value, unit } = age(behind.total);
      return (
        <span class="why" title={behindHint(behind)}>
          <span class="tag warn">{TEXT.behindBy(value, unit)}</span>
          {behindCause(behind)}
        </span>
      );
    }
    if (gaps === 0) return null;
    return (
      <span class="why">
        <span class="tag warn" data-about="time">
          {TEXT.gapCount(gaps)}
        </span>
        {TEXT.inTheLastMinute}
      </span>
    );
  }
  void app.tick.value;
  const now = app.store.serverNow();
  const last = health?.last_arrival ?? device.last_arrival;
  const ago = last === null || last === undefined ? "" : TEXT.timeAgo(age(now - last).value, age(now - last).unit);
  const left = device.next_attempt === null ? 0 : Math.ceil(device.next_attempt - now);
  const next = left > 0 ? TEXT.nextAttempt(left) : "";
  const words = [ago, next].filter(Boolean).join(" · ");
  const [tone, name] = ACTIONS[device.required_action] ?? NAMES[device.status];
  const wanted = device.status === "connecting" && keyWanted(health) !== ""; // it is received, and refused
  return (
    <span class="why">
      <span class={`tag ${wanted ? "warn" : tone}`}>{wanted ? TEXT.keyNeeded : name}</span>
      {device.status === "connecting" && next === "" ? (device.attempts.at(-1)?.what ?? "") : words}
    </span>
  );
}

/** What a device waits for while bytes arrive and none can be shown. */
const ACTIONS: Readonly<Partial<Record<DeviceInfo["required_action"], readonly [string, string]>>> = {
  key: ["warn", TEXT.keyNeeded],
  rearm: ["warn", TEXT.restarted],
};

const NAMES: Readonly<Record<Exclude<DeviceInfo["status"], "live">, readonly [string, string]>> = {
  connecting: ["", COMMON.connecting],
  lost: ["bad", COMMON.lost],
  denied: ["bad", COMMON.notPermitted],
  idle: ["", COMMON.idle],
  ended: ["", COMMON.ended],
};

/** The form for a name of one's own; Enter stores it. */
function NameForm({ app, device, close }: Pick<DeviceProps, "app" | "device"> & { readonly close: () => void }) {
  const field = useRef<HTMLInputElement>(null);
  useEffect(() => field.current?.select(), []);
  const store = (event: Event): void => {
    event.preventDefault();
    close();
    void run(app, api.nameDevice(device.id, field.current?.value ?? ""));
  };
  return (
    <form class="actions" onSubmit={store}>
      <input
        ref={field}
        class="grow"
        type="text"
        maxLength={60}
        aria-label={TEXT.nameOf(fullName(device))}
        title={TEXT.nameHint}
        placeholder={device.name}
        defaultValue={device.own_name}
        onKeyDown={(event) => {
          event.stopPropagation();
          if (event.key === "Escape") close();
        }}
      />
      <Button changes type="submit" look="small edge" words={COMMON.save} />
      <Button look="small" words={COMMON.cancel} onClick={close} />
    </form>
  );
}

function Acts({ app, device, shared, removing }: DeviceProps) {
  const naming = useSignal(false);
  if (naming.value) return <NameForm app={app} device={device} close={() => (naming.value = false)} />;
  if (removing.value === device.id) {
    const remove = (): void => {
      removing.value = undefined;
      void run(app, api.removeDevice(linkOf(device)));
    };
    return (
      <div class="actions">
        <span class="grow">{shared > 1 ? TEXT.confirmRemoveLink(shared) : TEXT.confirmRemove(fullName(device))}</span>
        <Button changes look="small edge" words={TEXT.remove} onClick={remove} />
        <Button look="small" words={COMMON.cancel} onClick={() => (removing.value = undefined)} />
      </div>
    );
  }
  return (
    <div class="actions">
      {device.status === "idle" && device.resume && <ResumeButton app={app} device={device} />}
      {device.status !== "live" && !(device.status === "idle" && device.resume) && (
        <Button
          changes
          look="small edge"
          words={device.status === "ended" ? TEXT.playAgain : TEXT.tryNow}
          onClick={() => void run(app, api.retryDevice(linkOf(device)))}
        />
      )}
      <Button
        changes
        look="small"
        words={TEXT.nameDevice}
        title={TEXT.nameHint}
        onClick={() => (naming.value = true)}
      />
      {(protocolOf(device.protocol)?.options.length ?? 0) > 0 && (
        <Button changes look="small" words={TEXT.reading} onClick={() => askKey(app, device)} />
      )}
      <Slot name="deviceActions" with={{ app, device }} />
      <span class="grow" />
      <Button
        changes
        look="small"
        words={shared > 1 ? TEXT.removeLink : TEXT.remove}
        onClick={() => (removing.value = device.id)}
      />
    </div>
  );
}

function mountSpark(host: HTMLElement, app: App, id: string): Panel {
  const canvas = el("canvas", { role: "img", "aria-label": TEXT.samplesPerSecondLastMinute });
  host.append(canvas);
  const due = throttle(2);
  let redraw = true;
  const to = surface(canvas, () => {
    redraw = true;
  });
  return {
    update(now) {
      if (!due(now) && !redraw) return;
      redraw = false;
      const gone = app.store.devices.peek().find((device) => device.id === id)?.status === "lost";
      drawBars(to, rateBars(app.recentHealth.of(id), app.store.edgeOf(id), 60), gone);
    },
    dispose() {
      to.dispose();
      canvas.remove();
    },
  };
}

/** A port without a device: the data found there, and a way to connect to it. */
function Ghost({ app, port }: { readonly app: App; readonly port: Port }) {
  const free = port.busy === "" && port.denied === "";
  return (
    <li class="device ghost">
      <div class="choose-device">
        <span class="dot off" />
        <b class="ellipsis">{shortSource(port.device)}</b>
        {free ? (
          <Button
            changes
            look="small edge"
            words={TEXT.connect}
            aria-label={TEXT.connectTo(shortSource(port.device))}
            onClick={() => void connect(app, port.device)}
          />
        ) : (
          <span />
        )}
        <span class="facts">
          <Message text={portWords(port)} />
        </span>
      </div>
    </li>
  );
}

/** One line about a port: why it cannot be opened, else the data found, else its description. */
export function portWords(port: Port): string {
  if (port.denied !== "") return port.denied;
  if (port.busy !== "") return TEXT.inUseBy(port.busy);
  const last = port.attempts.at(-1);
  return last ? `${last.what}: ${last.outcome}` : TEXT.notScanned(port.description);
}
