/** The programs that share the port of a device: who is there, who talks, what was lost; shares are added and ended. */
import { useSignal } from "@preact/signals";
import { bytes } from "../../recordings/library-filter";
import { Button } from "../../ui/controls/button";
import { Segmented } from "../../ui/controls/choices";
import { Dialog } from "../../ui/controls/dialog";
import { clock } from "../../ui/format/format";
import { type Outcome, request } from "../../requests/http";
import { Answered, useAnswer } from "../../requests/use-answer";
import { fullName } from "../../wire/device-name";
import type { PortShare, SettingsChange, SharedPort, ShareClient } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import type { App } from "../../page/context";
import { COMMON } from "../../texts/common";

import "./shares.css";
import { TEXT } from "./texts";

const ASK_EVERY_MS = 1000;
type Kind = PortShare["kind"];
const KINDS: readonly Kind[] = ["pty", "tcp", "udp"];
const FIRST_PORT = 4001;

interface State {
  readonly port: SharedPort;
  /** Sends a request; its answer is the new state, or a problem. */
  readonly send: (request: Promise<Outcome<SharedPort>>) => Promise<boolean>;
  readonly device: string;
}

interface Props {
  readonly app: App;
  readonly device: DeviceInfo;
  readonly onClose: () => void;
}

export function SharePort({ device, onClose }: Props) {
  const { id } = device;
  const path = { device: id };
  const asked = useAnswer(id, () => request("GET /api/devices/{device}/shares", { path }), {
    everyMs: ASK_EVERY_MS,
  });
  return (
    <Dialog title={TEXT.sharePortOf(fullName(device))} onClose={onClose}>
      <div class="port-shares stacked">
        <p>{TEXT.shareIntro}</p>
        <Answered of={asked}>{(port) => <Port port={port} state={{ port, send: asked.send, device: id }} />}</Answered>
      </div>
    </Dialog>
  );
}

function Port({ port, state }: { readonly port: SharedPort; readonly state: State }) {
  const { shares } = port;
  return (
    <>
      {shares.length > 0 ? <Speaker port={port} state={state} /> : <p class="dim">{port.why_not || TEXT.notShared}</p>}
      {shares.map((share) => (
        <Share key={share.name} share={share} state={state} />
      ))}
      {port.changes.length > 0 && <Changes changes={port.changes} />}
      {port.why_not === "" && <AddShare state={state} />}
    </>
  );
}

function Speaker({ port, state }: { readonly port: SharedPort; readonly state: State }) {
  const { speaker, configuring, holder } = port;
  const isAsking = useSignal(false);
  const takeOver = (): void => {
    isAsking.value = false;
    const input = { path: { device: state.device }, body: { confirmed: true } };
    void state.send(request("POST /api/devices/{device}/shares/take-over", input));
  };
  const text =
    speaker === "" ? TEXT.noCommands : configuring ? TEXT.configuringDevice(speaker) : TEXT.commandsFrom(speaker);
  return (
    <div class="port-speaker">
      <p role="status">
        <span class={`dot ${speaker === "" ? "off" : "live"}`} /> {text}
      </p>
      {configuring && !isAsking.value && (
        <Button changes look="small edge" words={TEXT.takeOver} onClick={() => (isAsking.value = true)} />
      )}
      {configuring && isAsking.value && (
        <div class="actions" role="group" aria-label={TEXT.takeOver}>
          <span class="grow">{TEXT.takeOverHint(speaker)}</span>
          <Button changes look="small edge" words={TEXT.takeOverFrom(speaker)} onClick={takeOver} />
          <Button look="small" words={COMMON.cancel} onClick={() => (isAsking.value = false)} />
        </div>
      )}
      {holder > 0 && <p class="dim">{TEXT.heldByProcess(holder)}</p>}
    </div>
  );
}

function Changes({ changes }: { readonly changes: readonly SettingsChange[] }) {
  return (
    <section class="port-share" aria-label={TEXT.changedByPrograms}>
      <b>{TEXT.changedByPrograms}</b>
      <ul>
        {changes.map((change) => (
          <li key={change.time} class="port-client text-sm">
            <div class="dim">{TEXT.changedBy(change.client, clock(change.time))}</div>
            <dl>
              {change.rows.map(({ title, before, after }) => (
                <Figure
                  key={title}
                  name={title}
                  value={TEXT.valueChange(before || TEXT.noValue, after || TEXT.noValue)}
                />
              ))}
            </dl>
            {change.unread.length > 0 && <div>{TEXT.notReadSince(change.unread.join(", "))}</div>}
          </li>
        ))}
      </ul>
    </section>
  );
}

function Share({ share, state }: { readonly share: PortShare; readonly state: State }) {
  const end = (): void => {
    const input = { path: { device: state.device }, query: { name: share.name } };
    void state.send(request("DELETE /api/devices/{device}/shares", input));
  };
  return (
    <section class="port-share" aria-label={share.name}>
      <div class="control-row">
        <b class="mono">{share.name}</b>
        <span class="dim">{share.read_only ? TEXT.readsOnly : ""}</span>
        <span class="grow" />
        <Button
          changes
          look="small edge"
          words={TEXT.endShare}
          aria-label={TEXT.endShareNamed(share.name)}
          onClick={end}
        />
      </div>
      {share.clients.length === 0 ? (
        <p class="dim">{TEXT.nobodyConnected}</p>
      ) : (
        <ul>
          {share.clients.map((client) => (
            <Client key={client.number} client={client} share={share} state={state} />
          ))}
        </ul>
      )}
    </section>
  );
}

interface ClientProps {
  readonly client: ShareClient;
  readonly share: PortShare;
  readonly state: State;
}

function Client({ client, share, state }: ClientProps) {
  const drop = (): void => {
    const path = { device: state.device, number: client.number };
    void state.send(request("DELETE /api/devices/{device}/shares/clients/{number}", { path }));
  };
  const lost = client.dropped_frames > 0 ? TEXT.frames(client.dropped_frames) : quantity(client.dropped_bytes);
  const access = client.may_write ? TEXT.mayWrite : TEXT.readsOnly;
  return (
    <li class="port-client text-sm">
      <div class="control-row">
        {client.name !== share.name && <b>{client.name}</b>}
        <span>{client.waits ? `${access}, ${TEXT.waitsForItsTurn}` : access}</span>
        {client.limited && <span class="tag warn">{TEXT.heldBack}</span>}
        <span class="grow" />
        <Button
          changes
          look="small"
          words={TEXT.disconnect}
          aria-label={TEXT.disconnectNamed(client.name)}
          onClick={drop}
        />
      </div>
      <dl>
        <Figure name={TEXT.toProgram} value={quantity(client.sent)} />
        <Figure name={TEXT.fromProgram} value={quantity(client.received)} />
        {client.refused > 0 && <Figure name={TEXT.refusedFromProgram} value={quantity(client.refused)} isBad />}
        <Figure name={TEXT.lostByProgram} value={lost} isBad={client.dropped_bytes > 0} />
      </dl>
    </li>
  );
}

function Figure({
  name,
  value,
  isBad = false,
}: {
  readonly name: string;
  readonly value: string;
  readonly isBad?: boolean;
}) {
  return (
    <div>
      <dt>{name}</dt>
      <dd class={isBad ? "tag warn" : ""}>{value}</dd>
    </div>
  );
}

function quantity(size: number): string {
  const { value, unit } = bytes(size);
  return `${value} ${unit}`;
}

function AddShare({ state }: { readonly state: State }) {
  const kind = useSignal<Kind>("pty");
  const typed = useSignal<string | undefined>(undefined);
  const readOnly = useSignal(false);
  const busy = useSignal(false);
  const names = new Set(state.port.shares.map(({ name }) => name));
  const address = typed.value ?? proposal(kind.value, state.port.folder, names);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    if (address.trim() === "" || busy.value) return;
    busy.value = true;
    const body = { address: `${address.trim()}${readOnly.value ? "?mode=read" : ""}` };
    const done = await state.send(
      request("POST /api/devices/{device}/shares", { path: { device: state.device }, body }),
    );
    busy.value = false;
    if (done) typed.value = undefined;
  };
  return (
    <form class="form" autocomplete="off" onSubmit={(event) => void submit(event)}>
      <Segmented
        label={TEXT.shareAs}
        class="full-width"
        value={kind.value}
        options={KINDS.map((one) => [one, TEXT.shareKinds[one]])}
        onChoose={(one) => {
          kind.value = one;
          typed.value = undefined;
        }}
      />
      <label for="share-address">{TEXT.shareAddress}</label>
      <div class="field">
        <input
          id="share-address"
          class="mono"
          value={address}
          spellcheck={false}
          autocapitalize="off"
          onInput={(event) => (typed.value = event.currentTarget.value)}
        />
      </div>
      <label class="flag">
        <input
          type="checkbox"
          class="check"
          checked={readOnly.value}
          onChange={(event) => (readOnly.value = event.currentTarget.checked)}
        />
        <span>{TEXT.onlyReading}</span>
      </label>
      <div class="row">
        <Button
          changes
          type="submit"
          look="main"
          words={busy.value ? TEXT.sharing : TEXT.shareNow}
          disabled={busy.value || address.trim() === ""}
        />
      </div>
    </form>
  );
}

/** An address that is not in use here, to begin with. */
export function proposal(kind: Kind, folder: string, names: ReadonlySet<string>): string {
  for (let n = 0; ; n += 1) {
    const address =
      kind === "pty" ? (folder === "" ? "" : `${folder}/imu${n}`) : `${kind}://127.0.0.1:${FIRST_PORT + n}`;
    if (!names.has(address)) return address;
  }
}
