/** Corrections: a stream of RTCM 3 from a caster, a server or a file, forwarded to the device in whole messages. */
import { type Signal, useSignal } from "@preact/signals";
import { Button } from "../../ui/controls/button";
import { Segmented } from "../../ui/controls/choices";
import { age, byteRate, number } from "../../ui/format/format";
import { Message } from "../../ui/controls/message";
import type { Model } from "../../pages/configure/model";
import { COMMON } from "../../texts/common";
import { type Outcome, request } from "../../requests/http";
import { Answered, useAnswer } from "../../requests/use-answer";
import type { Corrections as CorrectionsState } from "../../wire/form-types";
import { TEXT } from "./texts";
import "./corrections.css";

const ASK_EVERY_MS = 1000;

const pathOf = ({ id }: Model) => ({ device: id });

export function CorrectionsForm({ model }: { readonly model: Model }) {
  const path = pathOf(model);
  const ask = () => request("GET /api/devices/{device}/corrections", { path });
  const asked = useAnswer<CorrectionsState>(model.id, ask, { everyMs: ASK_EVERY_MS });
  const { answer: state } = asked;
  const kind = useSignal<"ntrip" | "other">("ntrip");
  const caster = useSignal<Ntrip>(BLANK);
  const other = useSignal("");
  const why = kind.value === "ntrip" ? ntripProblem(caster.value) : other.value.trim() === "" ? TEXT.sourceMissing : "";
  const change = (request: Promise<Outcome<CorrectionsState>>): void => {
    void asked.send(request);
    void model.run(request);
  };
  const start = (event: Event): void => {
    event.preventDefault();
    if (why !== "") return;
    const source = kind.value === "ntrip" ? ntripUrl(caster.value) : other.value.trim();
    change(request("PUT /api/devices/{device}/corrections", { path, body: { source } }));
  };
  const stop = (): void => change(request("DELETE /api/devices/{device}/corrections", { path }));
  return (
    <section class="setting" aria-label={TEXT.corrections}>
      <div class="setting-words">
        <p>{TEXT.correctionsIntro}</p>
      </div>
      <form class="form correction-form inset" autocomplete="off" onSubmit={start}>
        <Segmented
          label={TEXT.sourceKind}
          value={kind.value}
          options={[
            ["ntrip", TEXT.ntripCaster],
            ["other", TEXT.tcpServerOrFile],
          ]}
          onChoose={(one) => (kind.value = one)}
        />
        {kind.value === "ntrip" ? <CasterFields caster={caster} /> : <OtherField source={other} />}
        <div class="correction-row control-row">
          <Button
            changes
            type="submit"
            look="main"
            words={state?.running ? TEXT.restart : TEXT.start}
            disabled={why !== ""}
            aria-describedby="rtcm-why"
          />
          <Button changes look="edge" words={COMMON.stop} disabled={!state?.source} onClick={stop} />
          <span class="dim" id="rtcm-why">
            {why}
          </span>
        </div>
      </form>
      <Answered of={asked}>{(now) => now.source !== "" && <Figures state={now} />}</Answered>
    </section>
  );
}

const PLAIN = { autocomplete: "off", autocapitalize: "off", spellcheck: false } as const;

function CasterFields({ caster }: { readonly caster: Signal<Ntrip> }) {
  const set = (part: Partial<Ntrip>): void => {
    caster.value = { ...caster.value, ...part };
  };
  const text = (id: string, label: string, key: "host" | "port" | "mount" | "user", placeholder: string) => (
    <div class="correction-field">
      <label for={id}>{label}</label>
      <div class="field">
        <input
          id={id}
          type="text"
          value={caster.value[key]}
          placeholder={placeholder}
          {...PLAIN}
          inputMode={key === "port" ? "numeric" : "text"}
          onInput={(event) => set({ [key]: event.currentTarget.value })}
        />
      </div>
    </div>
  );
  return (
    <div class="correction-grid">
      {text("ntrip-host", TEXT.host, "host", "caster.example.com")}
      {text("ntrip-port", TEXT.port, "port", caster.value.tls ? "443" : "2101")}
      {text("ntrip-mount", TEXT.mountPoint, "mount", "MOUNT")}
      {text("ntrip-user", TEXT.user, "user", "")}
      <div class="correction-field">
        <label for="ntrip-password">{TEXT.password}</label>
        <div class="field">
          <input
            id="ntrip-password"
            type="password"
            value={caster.value.password}
            autocomplete="new-password"
            onInput={(event) => set({ password: event.currentTarget.value })}
          />
        </div>
      </div>
      <label class="flag correction-tls">
        <input
          type="checkbox"
          class="check"
          checked={caster.value.tls}
          onChange={(event) => set({ tls: event.currentTarget.checked })}
        />
        <span>{TEXT.tls}</span>
      </label>
    </div>
  );
}

function OtherField({ source }: { readonly source: Signal<string> }) {
  return (
    <div class="correction-field">
      <label for="rtcm-source">{TEXT.source}</label>
      <div class="field">
        <input
          id="rtcm-source"
          class="mono"
          type="text"
          value={source.value}
          placeholder={TEXT.tcpHostPort}
          {...PLAIN}
          aria-describedby="rtcm-examples"
          onInput={(event) => (source.value = event.currentTarget.value)}
        />
      </div>
      <p class="dim" id="rtcm-examples">
        <span class="mono">{TEXT.tcpHostPort}</span> {TEXT.sourceExamples}
      </p>
    </div>
  );
}

function Figures({ state }: { readonly state: CorrectionsState }) {
  const rate = byteRate(state.bytes_per_s);
  const since = age(state.age_s ?? undefined);
  const flow = flowOf(state);
  return (
    <div class="inset text-sm">
      <p role="status">
        <span class={`dot ${flow.dot}`} /> <b>{flow.word}</b> <span class="mono">{state.source}</span>
      </p>
      {state.message && (
        <p class={state.forwarding ? "mid" : "problem"}>
          <Message text={state.message} /> <Message text={state.hint} />
        </p>
      )}
      <dl class="answer">
        <div>
          <dt>{TEXT.ageOfTheLastMessage}</dt>
          <dd>
            {since.value}
            <span class="unit">{since.unit}</span>
          </dd>
        </div>
        <div>
          <dt>{TEXT.forwarded}</dt>
          <dd>
            {rate.value}
            <span class="unit">{rate.unit}</span>
          </dd>
        </div>
        <div>
          <dt>{TEXT.rejectedByDevice}</dt>
          <dd>{number(state.refused, 0)}</dd>
        </div>
        <div>
          <dt>{TEXT.checksumErrors}</dt>
          <dd>{number(state.rejected, 0)}</dd>
        </div>
        {Object.entries(state.messages).map(([name, times]) => (
          <div key={name}>
            <dt>
              {TEXT.rtcm} <span class="mono">{name}</span>
            </dt>
            <dd>{number(times, 0)}</dd>
          </div>
        ))}
      </dl>
    </div>
  );
}

interface Ntrip {
  readonly host: string;
  readonly port: string;
  readonly mount: string;
  readonly user: string;
  readonly password: string;
  readonly tls: boolean;
}

export const BLANK: Ntrip = { host: "", port: "", mount: "", user: "", password: "", tls: false };

/** ntrip://user:password@host:2101/MOUNT; every part quoted, so that a password may contain anything. */
export function ntripUrl({ host, port, mount, user, password, tls }: Ntrip): string {
  const who = user || password ? `${encodeURIComponent(user)}:${encodeURIComponent(password)}@` : "";
  const name = host.trim();
  const address = name.includes(":") && !name.startsWith("[") ? `[${name}]` : name;
  return `${tls ? "ntrips" : "ntrip"}://${who}${address}${port.trim() ? `:${port.trim()}` : ""}/${encodeURIComponent(mount.trim())}`;
}

/** The missing or invalid part, in a sentence; "" for none. */
export function ntripProblem({ host, port, mount }: Ntrip): string {
  if (host.trim() === "") return TEXT.hostMissing;
  if (/[\s/@]/.test(host.trim())) return TEXT.hostInvalid;
  if (port.trim() !== "" && !(/^\d{1,5}$/.test(port.trim()) && Number(port) >= 1 && Number(port) <= 65_535))
    return TEXT.portInvalid;
  return mount.trim() === "" ? TEXT.mountPointMissing : "";
}

/** State of a stream in a word; one that is only being tried is not running. */
export function flowOf({
  running,
  forwarding,
  age_s,
}: {
  readonly running: boolean;
  readonly forwarding: boolean;
  readonly age_s: number | null;
}): { readonly word: string; readonly dot: string } {
  if (!running) return { word: TEXT.stopped, dot: "off" };
  if (!forwarding) return { word: TEXT.retrying, dot: "bad" };
  return (age_s ?? 0) > OLD_S ? { word: TEXT.forwardingIdle, dot: "warn" } : { word: TEXT.forwarding, dot: "live" };
}

const OLD_S = 10;
