/** Corrections: a stream of RTCM 3 from a caster, a server or a file, forwarded to the device in whole messages. */
import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { BLANK, flowOf, type Ntrip, ntripProblem, sourceOf } from "../../forms/ntrip";
import type { Corrections as State } from "../../forms/types";
import { age, byteRate, number } from "../../ui/format";
import { Message } from "../../ui/message";
import { type Model, viewOnly } from "./model";
import { server } from "./api";

const ASK_EVERY_MS = 1000;

export function Corrections({ model }: { readonly model: Model }) {
  const state = useSignal<State | undefined>(undefined);
  const kind = useSignal<"ntrip" | "other">("ntrip");
  const caster = useSignal<Ntrip>(BLANK);
  const other = useSignal("");
  useEffect(() => {
    const ask = async (): Promise<void> => {
      const answer = await server.corrections(model.id);
      if (answer.ok) state.value = answer.value;
    };
    void ask();
    const timer = setInterval(() => void ask(), ASK_EVERY_MS);
    return () => clearInterval(timer);
  }, [model]);
  const why = kind.value === "ntrip" ? ntripProblem(caster.value) : other.value.trim() === "" ? "The source is missing." : "";
  const start = async (event: Event): Promise<void> => {
    event.preventDefault();
    if (why !== "") return;
    const found = await model.run(server.startCorrections(model.id, kind.value === "ntrip" ? sourceOf(caster.value) : other.value.trim()));
    if (found) state.value = found;
  };
  const stop = async (): Promise<void> => {
    const found = await model.run(server.stopCorrections(model.id));
    if (found) state.value = found;
  };
  return (
    <section class="setting" aria-label="Corrections">
      <div class="setwords">
        <p>A stream of RTCM 3 is forwarded to the device in whole messages, as it arrives. The server keeps it going, also when this page is closed.</p>
      </div>
      <form class="form corrform inset" autocomplete="off" onSubmit={(event) => void start(event)}>
        <div class="seg" role="group" aria-label="Kind of source">
          <button type="button" aria-pressed={kind.value === "ntrip"} onClick={() => (kind.value = "ntrip")}>
            NTRIP caster
          </button>
          <button type="button" aria-pressed={kind.value === "other"} onClick={() => (kind.value = "other")}>
            TCP server or file
          </button>
        </div>
        {kind.value === "ntrip" ? <CasterFields caster={caster} /> : <OtherField source={other} />}
        <div class="corrrow">
          <button type="submit" class="btn main" disabled={viewOnly.value || why !== ""} aria-describedby="rtcm-why">
            {state.value?.running ? "Restart" : "Start"}
          </button>
          <button type="button" class="btn edge" disabled={viewOnly.value || !state.value?.source} onClick={() => void stop()}>
            Stop
          </button>
          <span class="dim" id="rtcm-why">
            {why}
          </span>
        </div>
      </form>
      {state.value && state.value.source !== "" && <Figures state={state.value} />}
    </section>
  );
}

const PLAIN = { autocomplete: "off", autocapitalize: "off", spellcheck: false } as const;

function CasterFields({ caster }: { readonly caster: Signal<Ntrip> }) {
  const set = (part: Partial<Ntrip>): void => {
    caster.value = { ...caster.value, ...part };
  };
  const text = (id: string, label: string, key: "host" | "port" | "mount" | "user", placeholder: string) => (
    <div class="corrfield">
      <label for={id}>{label}</label>
      <div class="field">
        <input id={id} type="text" value={caster.value[key]} placeholder={placeholder} {...PLAIN} inputMode={key === "port" ? "numeric" : "text"} onInput={(event) => set({ [key]: event.currentTarget.value })} />
      </div>
    </div>
  );
  return (
    <div class="corrgrid">
      {text("ntrip-host", "Host", "host", "caster.example.com")}
      {text("ntrip-port", "Port", "port", caster.value.tls ? "443" : "2101")}
      {text("ntrip-mount", "Mount point", "mount", "MOUNT")}
      {text("ntrip-user", "User", "user", "")}
      <div class="corrfield">
        <label for="ntrip-password">Password</label>
        <div class="field">
          <input id="ntrip-password" type="password" value={caster.value.password} autocomplete="new-password" onInput={(event) => set({ password: event.currentTarget.value })} />
        </div>
      </div>
      <label class="flag corrtls">
        <input type="checkbox" class="check" checked={caster.value.tls} onChange={(event) => set({ tls: event.currentTarget.checked })} />
        <span>TLS</span>
      </label>
    </div>
  );
}

function OtherField({ source }: { readonly source: Signal<string> }) {
  return (
    <div class="corrfield">
      <label for="rtcm-source">Source</label>
      <div class="field">
        <input id="rtcm-source" class="mono" type="text" value={source.value} placeholder="tcp://host:port" {...PLAIN} aria-describedby="rtcm-examples" onInput={(event) => (source.value = event.currentTarget.value)} />
      </div>
      <p class="dim" id="rtcm-examples">
        <span class="mono">tcp://host:port</span> of a server, or the path of a file on this host.
      </p>
    </div>
  );
}

function Figures({ state }: { readonly state: State }) {
  const rate = byteRate(state.bytes_per_s);
  const since = age(state.age_s ?? undefined);
  const flow = flowOf(state);
  return (
    <div class="inset corrfigures">
      <p role="status">
        <span class={`dot ${flow.dot}`} /> <b>{flow.word}</b>{" "}
        <span class="mono">{state.source}</span>
      </p>
      {state.message && (
        <p class={state.forwarding ? "mid" : "problem"}>
          <Message text={state.message} /> <Message text={state.hint} />
        </p>
      )}
      <dl class="answer">
        <div>
          <dt>Age of the last message</dt>
          <dd>
            {since.value}
            <span class="u">{since.unit}</span>
          </dd>
        </div>
        <div>
          <dt>Forwarded</dt>
          <dd>
            {rate.value}
            <span class="u">{rate.unit}</span>
          </dd>
        </div>
        <div>
          <dt>Refused by the device</dt>
          <dd>{number(state.refused, 0)}</dd>
        </div>
        <div>
          <dt>Bad checksums</dt>
          <dd>{number(state.rejected, 0)}</dd>
        </div>
        {Object.entries(state.messages).map(([name, times]) => (
          <div key={name}>
            <dt>
              RTCM <span class="mono">{name}</span>
            </dt>
            <dd>{number(times, 0)}</dd>
          </div>
        ))}
      </dl>
    </div>
  );
}
