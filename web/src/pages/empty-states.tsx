/** What stands in the plots' place while there is nothing to plot: the cause, the facts seen, and one main action. */
import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { api, type Problem } from "../ui/http";
import { age } from "../ui/format";
import { Message } from "../ui/message";
import { shortSource } from "../ui/page-state";
import type { DeviceInfo, Try } from "../wire/types";
import { type App, connect, linkOf, overlay, ports, problem, run, scanning, scanPorts, tick } from "./app-state";
import { portWords } from "./device-sidebar";
import { SavedBand } from "./record-button";

/** Why the server does not let us in, once asked. */
export const refusal = signal<Problem | undefined>(undefined);

export function Starting() {
  const refused = refusal.value;
  return (
    <Card title={refused ? "The server does not let this page in" : "Connecting to imuscope"} dot={refused ? "bad" : "off"}>
      <p>{refused ? <Message text={refused.message} /> : "The page is here; the live connection to the server is being opened."}</p>
      {refused && <p class="hint"><Message text={refused.hint || "Open the address that was printed when imuscope was started: it carries the token."} /></p>}
      <div class="row">
        <button type="button" class="btn main" onClick={() => location.reload()}>
          Reload
        </button>
      </div>
    </Card>
  );
}

export function Empty() {
  return (
    <Card title="No device yet">
      <p>Plug a sensor in, or point imuscope at one.</p>
      {ports.value.length > 0 ? (
        <ol class="tries">
          {ports.value.map((port) => (
            <li key={port.device}>
              <b>{shortSource(port.device)}</b>
              <span><Message text={portWords(port)} /></span>
            </li>
          ))}
        </ol>
      ) : (
        <p class="hint">No serial port was found on this host.</p>
      )}
      <div class="row">
        <button type="button" class="btn main" disabled={scanning.value} onClick={() => void scanPorts()}>
          {scanning.value ? "Listening on every port…" : "Scan ports"}
        </button>
        <button type="button" class="btn edge" onClick={() => (overlay.value = "add")}>
          Add an address
        </button>
        <button type="button" class="btn" onClick={() => void connect("twin:xbus")}>
          Start a twin
        </button>
      </div>
    </Card>
  );
}

export function Connecting({ app, device }: { readonly app: App; readonly device: DeviceInfo }) {
  return (
    <Card title={`Connecting to ${shortSource(device.source)}`} dot="off">
      <p><Message text={device.message || "Each try is shown as it is made."} /></p>
      <Tries tries={device.tries} />
      {device.hint !== "" && <p class="hint"><Message text={device.hint} /></p>}
      <p class="dim">
        <NextTry app={app} device={device} />
      </p>
      <Choices device={device} stop={device.next_try === null} />
    </Card>
  );
}

export function Denied({ device }: { readonly device: DeviceInfo }) {
  return (
    <Card title={`No permission for ${shortSource(device.source)}`} dot="bad">
      <p><Message text={device.message || "The operating system does not let imuscope open this port."} /></p>
      <p class="hint"><Message text={device.hint || "Give the user that runs imuscope access to the port, then try again."} /></p>
      <Tries tries={device.tries} />
      <Choices device={device} />
    </Card>
  );
}

export function Unreached({ app, device }: { readonly app: App; readonly device: DeviceInfo }) {
  return (
    <Card title={`${device.name} cannot be reached`} dot="bad">
      <p>
        <Message text={device.message} /> <NextTry app={app} device={device} />
      </p>
      {device.hint !== "" && <p class="hint"><Message text={device.hint} /></p>}
      <Tries tries={device.tries} />
      <Choices device={device} />
    </Card>
  );
}

export function Silent({ device }: { readonly device: DeviceInfo }) {
  return (
    <Card title={`${device.name} is open, and silent`} dot="off">
      <p><Message text={device.message || "The link is up. No sample has come over it so far."} /></p>
      <p class="hint"><Message text={device.hint || "Is the device in measurement mode, and are outputs switched on? A device in configuration mode sends nothing."} /></p>
      <Tries tries={device.tries} />
      <Choices device={device} />
    </Card>
  );
}

function Choices({ device, stop = false }: { readonly device: DeviceInfo; readonly stop?: boolean }) {
  return (
    <div class="row">
      {!stop && (
        <button type="button" class="btn main" onClick={() => void run(api.retryDevice(linkOf(device)))}>
          Try now
        </button>
      )}
      <button type="button" class="btn edge" onClick={() => void run(api.removeDevice(linkOf(device)))}>
        {stop ? "Stop" : "Remove"}
      </button>
      <button type="button" class="btn" onClick={() => (overlay.value = "add")}>
        {device.link === "serial" ? "Set the baud rate myself" : "Add another address"}
      </button>
    </div>
  );
}

function Tries({ tries }: { readonly tries: readonly Try[] }) {
  if (tries.length === 0) return null;
  return (
    <ol class="tries" aria-label="Tries so far" aria-live="polite" tabIndex={0}>
      {tries.slice(-12).map((one) => (
        <li key={`${one.time} ${one.what}`}>
          <b>{one.what}</b>
          <span><Message text={one.outcome} /></span>
        </li>
      ))}
    </ol>
  );
}

interface CardProps {
  readonly title: string;
  readonly dot?: "off" | "bad";
  readonly children: ComponentChildren;
}

function Card({ title, dot, children }: CardProps) {
  return (
    <div class="veil">
      <section class="card">
        <h2>
          {dot && <span class={`dot ${dot}`} />}
          {title}
        </h2>
        {children}
      </section>
    </div>
  );
}

function NextTry({ app, device }: { readonly app: App; readonly device: DeviceInfo }) {
  void tick.value;
  if (device.next_try === null) return null;
  const left = Math.ceil(device.next_try - app.store.serverNow());
  return <>{left > 0 ? `Next try in ${left} s.` : "Trying now."}</>;
}

/** The band over the plots of a device whose newest value is old. */
export function HeldBand({ app, device }: { readonly app: App; readonly device: DeviceInfo }) {
  void tick.value;
  const state = app.state.value;
  const last = app.store.health.value.get(device.id)?.last_arrival ?? device.last_arrival;
  const old = age(last === null ? undefined : app.store.serverNow() - last);
  const calm = state !== "lost";
  const title = { lost: "lost", ended: "has ended", idle: "is quiet" }[state as "lost" | "ended" | "idle"];
  return (
    <div class={`band ${calm ? "calm" : ""}`} role="status">
      <span class={`dot ${calm ? "off" : "bad"}`} />
      <b>
        {device.name} {title}
      </b>
      <span class="mid">
        <Message text={device.message} />
        {last !== null && ` Last sample ${old.value} ${old.unit} ago.`} <NextTry app={app} device={device} /> <Message text={device.hint} />
      </span>
      <span class="grow" />
      <button type="button" class="btn edge" onClick={() => void run(api.retryDevice(linkOf(device)))}>
        {state === "ended" ? "Play again" : "Try now"}
      </button>
    </div>
  );
}

/** The band of a page that has lost its server: what is on screen stays, and says that it is old. */
export function OfflineBand({ app }: { readonly app: App }) {
  void tick.value;
  const refused = refusal.value;
  const since = app.store.silentSince.value;
  const silent = age(since === undefined ? undefined : app.store.serverNow() - since);
  return (
    <div class="band" role="alert">
      <span class="dot bad" />
      <b>{refused ? "The server refuses this page" : since === undefined ? "No connection to imuscope" : "Nothing comes from imuscope"}</b>
      <span class="mid">
        {refused
          ? <Message text={`${refused.message} ${refused.hint}`} />
          : since === undefined
            ? "The server has stopped or the network is down. What you see is what came before; the page tries again by itself."
            : `For ${silent.value} ${silent.unit}: the network is down or the server hangs. What you see is what came before.`}
      </span>
      <span class="grow" />
      <button type="button" class="btn edge" onClick={() => app.store.retry()}>
        Try now
      </button>
    </div>
  );
}

/** Where the WebSocket is: the page's own host, with the page's own kind of security. */
export function socketUrl(): string {
  return `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`;
}

/** What every page tells in bands of its own: a request that failed, until it is read, and a recording that has ended. */
export function ProblemBand() {
  return (
    <>
      <FailedBand />
      <SavedBand />
    </>
  );
}

function FailedBand() {
  const shown = problem.value;
  if (!shown) return null;
  return (
    <div class="band" role="alert">
      <span class="dot bad" />
      <b><Message text={shown.message} /></b>
      <span class="mid"><Message text={shown.hint} /></span>
      <span class="grow" />
      <button type="button" class="btn edge" onClick={() => (problem.value = undefined)}>
        Close
      </button>
    </div>
  );
}
