/** Placeholder for the plots while there is nothing to plot: the cause, the facts, and one main action. */
import { Slot } from "../extension/extension";
import { Button } from "../ui/controls/button";
import { api, type HttpProblem } from "../requests/http";
import { Band } from "../ui/controls/band";
import { Card, Hint } from "../ui/controls/card";
import { age, clock } from "../ui/format/format";
import { Message } from "../ui/controls/message";
import { shortSource } from "../page/page-state";
import { deviceInLink, fullName, writeName } from "../wire/device-name";
import { capabilities } from "../wire/capabilities";
import type { DeviceInfo } from "../wire/types";
import { connect, linkOf, run, scanPorts } from "../page/app-state";
import type { App } from "../page/context";
import { portWords } from "./device-sidebar";
import { OpenFile } from "./open-file";
import { SavedBand } from "./record-button";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";

declare module "../extension/extension" {
  interface Slots {
    /** Bands over every page. */
    readonly bands: { readonly app: App };
  }
}

interface Props {
  readonly app: App;
}

interface DeviceProps extends Props {
  readonly device: DeviceInfo;
}

const titleOf = (refusal: HttpProblem): string => (refusal.status > 0 ? TEXT.accessRefused : TEXT.noConnection);

export function Starting({ app }: Props) {
  const refused = app.refusal.value;
  return (
    <Card
      title={refused ? titleOf(refused) : TEXT.connectingToImuscope}
      dot={refused ? "bad" : "off"}
      message={refused ? refused.message : TEXT.connectingToServer}
      hint={refused && (refused.hint || TEXT.openPrintedAddress)}
    >
      <div class="row">
        <Button look="main" words={TEXT.reload} onClick={() => location.reload()} />
      </div>
    </Card>
  );
}

export function Empty({ app }: Props) {
  const { ports, scanning } = app;
  const simulated = capabilities.value.protocols.find(({ simulator }) => simulator);
  return (
    <Card
      title={TEXT.noDeviceYet}
      message={TEXT.plugInSensor}
      hint={ports.value.length > 0 ? undefined : TEXT.noSerialPort}
    >
      {ports.value.length > 0 && (
        <ol class="attempts mid text-sm">
          {ports.value.map((port) => (
            <li key={port.device}>
              <b>{shortSource(port.device)}</b>
              <span>
                <Message text={portWords(port)} />
              </span>
            </li>
          ))}
        </ol>
      )}
      <div class="row">
        <Button
          changes
          look="main"
          words={scanning.value ? TEXT.scanningPorts : TEXT.scanPorts}
          disabled={scanning.value}
          onClick={() => void scanPorts(app)}
        />
        <Button changes look="edge" words={TEXT.addAnAddress} onClick={() => (app.overlay.value = "add")} />
        <OpenFile app={app} look="edge" />
        {simulated && (
          <Button changes words={TEXT.startASimulator} onClick={() => void connect(app, `sim:${simulated.name}`)} />
        )}
      </div>
    </Card>
  );
}

export function Connecting({ app, device }: DeviceProps) {
  return (
    <Card
      title={TEXT.connectingTo(shortSource(device.source))}
      dot="off"
      message={device.message || TEXT.attemptsFollow}
    >
      <Attempts device={device} />
      {device.hint !== "" && <Hint text={device.hint} />}
      <p class="dim">
        <NextTry app={app} device={device} />
      </p>
      <Choices app={app} device={device} stop={device.next_attempt === null} />
    </Card>
  );
}

export function Denied({ app, device }: DeviceProps) {
  return (
    <Card
      title={TEXT.noPermissionFor(shortSource(device.source))}
      dot="bad"
      message={device.message || TEXT.portPermissionDenied}
      hint={device.hint || TEXT.grantPortAccess}
    >
      <Attempts device={device} />
      <Choices app={app} device={device} />
    </Card>
  );
}

export function Unreached({ app, device }: DeviceProps) {
  return (
    <Card title={TEXT.cannotBeReached(fullName(device))} dot="bad">
      <p>
        <Message text={device.message} /> <NextTry app={app} device={device} />
      </p>
      {device.hint !== "" && <Hint text={device.hint} />}
      <Attempts device={device} />
      <Choices app={app} device={device} />
    </Card>
  );
}

/** Samples come to the server, and are on their way to the page. */
export function Loading({ device }: { readonly device: DeviceInfo }) {
  return <Card title={TEXT.isLoading(fullName(device))} dot="off" message={TEXT.samplesOnTheirWay} />;
}

/** A link named a device that is not connected: another one is shown, and this says so. */
export function LinkedBand({ app }: Props) {
  const { linked, store } = app;
  const name = linked.value;
  if (name === undefined || store.devices.value.length === 0) return null;
  if (deviceInLink(name, store.devices.value) !== undefined) return null;
  return (
    <Band tone="calm" dot="warn" title={TEXT.notConnectedHere} data-key="linked">
      <span class="grow">{TEXT.linkNames(name)}</span>
      <Button look="small" words={TEXT.dismiss} onClick={() => (linked.value = undefined)} />
    </Band>
  );
}

export function Silent({ app, device }: DeviceProps) {
  return (
    <Card
      title={TEXT.isSilent(fullName(device))}
      dot="off"
      message={device.message || TEXT.linkUpNoSample}
      hint={device.hint || TEXT.silentHint}
    >
      <Attempts device={device} />
      <Choices app={app} device={device} />
    </Card>
  );
}

function Choices({ app, device, stop = false }: DeviceProps & { readonly stop?: boolean }) {
  return (
    <div class="row">
      {!stop && (
        <Button
          changes
          look="main"
          words={TEXT.tryNow}
          onClick={() => void run(app, api.retryDevice(linkOf(device)))}
        />
      )}
      <Button
        changes
        look="edge"
        words={stop ? COMMON.stop : TEXT.remove}
        onClick={() => void run(app, api.removeDevice(linkOf(device)))}
      />
      <Button
        changes
        words={device.link === "serial" ? TEXT.setBaudRate : TEXT.addAnotherAddress}
        onClick={() => (app.overlay.value = "add")}
      />
    </div>
  );
}

/** The last attempts, but for those of which the message of the device says the same. */
function Attempts({ device }: { readonly device: DeviceInfo }) {
  const attempts = device.attempts.filter(({ outcome }) => outcome !== device.message).slice(-12);
  if (attempts.length === 0) return null;
  return (
    <ol class="attempts mid text-sm" aria-label={TEXT.attempts} aria-live="polite" tabIndex={0}>
      {attempts.map((one) => (
        <li key={`${one.time} ${one.what}`}>
          <b>{one.what}</b>
          <span>
            <Message text={one.outcome} />
          </span>
        </li>
      ))}
    </ol>
  );
}

function NextTry({ app, device }: DeviceProps) {
  void app.tick.value;
  if (device.next_attempt === null) return null;
  const left = Math.ceil(device.next_attempt - app.store.serverNow());
  return <>{left > 0 ? TEXT.nextAttemptIn(left) : TEXT.tryingNow}</>;
}

/** The band over the plots of a device whose newest value is old. */
export function HeldBand({ app, device }: DeviceProps) {
  void app.tick.value;
  const state = app.state.value;
  const last = app.store.health.value.get(device.id)?.last_arrival ?? device.last_arrival;
  const old = age(last === null ? undefined : app.store.serverNow() - last);
  const calm = state !== "lost";
  const title = { lost: COMMON.status.lost, ended: TEXT.hasEnded, idle: TEXT.isIdle }[
    state as "lost" | "ended" | "idle"
  ];
  const words = (
    <>
      <Message text={device.message} /> {device.quiet_since ? COMMON.quietSince(clock(device.quiet_since)) : ""}
      {last !== null && TEXT.lastSampleAgo(old.value, old.unit)} <NextTry app={app} device={device} />{" "}
      <Message text={device.hint} />
    </>
  );
  return (
    <Band
      tone={calm ? "calm" : undefined}
      role="status"
      dot={calm ? "off" : "bad"}
      title={`${fullName(device)} ${title}`}
      words={words}
    >
      {!device.resume ? (
        <Button
          changes
          look="edge"
          words={state === "ended" ? TEXT.playAgain : TEXT.tryNow}
          onClick={() => void run(app, api.retryDevice(linkOf(device)))}
        />
      ) : (
        <ResumeButton app={app} device={device} />
      )}
    </Band>
  );
}

/** Makes a device send again that is quiet for a known reason. */
export function ResumeButton({ app, device }: DeviceProps) {
  const named = writeName(device.id, app.store.devices.value);
  const resume = (): void => void run(app, api.runCommand(named, device.resume));
  return <Button changes look="edge" words={COMMON.startMeasuring} title={device.resume} onClick={resume} />;
}

/** The band of a page without its server: the display stays and is marked as old. */
export function OfflineBand({ app }: Props) {
  void app.tick.value;
  const refused = app.refusal.value;
  const since = app.store.silentSince.value;
  const silent = age(since === undefined ? undefined : app.store.serverNow() - since);
  const words = since === undefined ? TEXT.serverStopped : TEXT.silentFor(silent.value, silent.unit);
  return (
    <Band
      dot="bad"
      title={refused ? titleOf(refused) : since === undefined ? TEXT.noConnection : TEXT.noDataFromServer}
      words={<Message text={refused ? `${refused.message} ${refused.hint}` : words} />}
    >
      <Button look="edge" words={TEXT.tryNow} onClick={() => app.store.retry()} />
    </Band>
  );
}

/** Bands of every page: those of extensions, a failed request, until it is read, and a recording that has ended. */
export function ProblemBand({ app }: Props) {
  return (
    <>
      <Slot name="bands" with={{ app }} />
      <FailedBand app={app} />
      <SavedBand app={app} />
    </>
  );
}

function FailedBand({ app: { problem } }: Props) {
  const shown = problem.value;
  if (!shown) return null;
  return (
    <Band dot="bad" title={<Message text={shown.message} />} words={<Message text={shown.hint} />}>
      <Button look="edge" words={COMMON.close} onClick={() => (problem.value = undefined)} />
    </Band>
  );
}
