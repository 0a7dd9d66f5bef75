/** Corrections: a stream of RTCM 3 from a caster, a server or a file, passed on to the device in whole messages. */
import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Corrections as State } from "../../forms/types";
import { age, byteRate, number } from "../../ui/format";
import { type Model, viewOnly } from "./model";
import { server } from "./server";

const states = signal<Readonly<Record<string, State>>>({});
const source = signal("");
const ASK_EVERY_MS = 1000;

export function Corrections({ model }: { readonly model: Model }) {
  const state = states.value[model.id];
  const keep = (found: State): void => {
    states.value = { ...states.value, [model.id]: found };
  };
  useEffect(() => {
    const ask = async (): Promise<void> => {
      const answer = await server.corrections(model.id);
      if (answer.ok) keep(answer.value);
    };
    void ask();
    const timer = setInterval(() => void ask(), ASK_EVERY_MS);
    return () => clearInterval(timer);
  }, [model]);
  const start = async (event: Event): Promise<void> => {
    event.preventDefault();
    const found = await model.run(server.startCorrections(model.id, source.value.trim()));
    if (found) keep(found);
  };
  const stop = async (): Promise<void> => {
    const found = await model.run(server.stopCorrections(model.id));
    if (found) keep(found);
  };
  return (
    <section class="setting" aria-label="Corrections">
      <div class="setwords">
        <p>A stream of RTCM 3 is passed on to the device in whole messages, as it comes. The server keeps it going, also when this page is closed.</p>
      </div>
      <form class="form corrform inset" onSubmit={(event) => void start(event)}>
        <label for="rtcm-source">Source</label>
        <div class="corrrow">
          <div class="field">
            <input
              id="rtcm-source"
              class="mono"
              type="text"
              value={source.value}
              placeholder="ntrip://user:password@caster:2101/MOUNT"
              autocomplete="off"
              autocapitalize="off"
              spellcheck={false}
              aria-describedby="rtcm-examples"
              onInput={(event) => (source.value = event.currentTarget.value)}
            />
          </div>
          <button type="submit" class="btn main" disabled={viewOnly.value || source.value.trim() === ""}>
            {state?.running ? "Start anew" : "Start"}
          </button>
          <button type="button" class="btn edge" disabled={viewOnly.value || !state?.source} onClick={() => void stop()}>
            Stop
          </button>
        </div>
        <p class="dim" id="rtcm-examples">
          <span class="mono">ntrip://host:2101/MOUNT</span> a caster, <span class="mono">tcp://host:port</span> a server, or a file of this host. The password is never told again.
        </p>
      </form>
      {state && state.source !== "" && <Figures state={state} />}
    </section>
  );
}

function Figures({ state }: { readonly state: State }) {
  const rate = byteRate(state.bytes_per_s);
  const since = age(state.age_s ?? undefined);
  const isOld = (state.age_s ?? 0) > 10;
  return (
    <div class="inset corrfigures">
      <p role="status">
        <span class={`dot ${state.running ? (isOld ? "warn" : "live") : state.message ? "bad" : "off"}`} /> <b>{state.running ? "Running" : "Stopped"}</b>{" "}
        <span class="mono">{state.source}</span>
      </p>
      {state.message && (
        <p class={state.running ? "mid" : "problem"}>
          {state.message} {state.hint}
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
          <dt>Passed on</dt>
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
