/** The right side: every frame to and from the device, what it says and how long it took; what waits; bytes by hand. */
import { type Signal, useSignal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import { spaced } from "../../forms/frame-chips";
import { clock, number } from "../../ui/format";
import { Icon } from "../../ui/icons";
import { Message } from "../../ui/message";
import type { ExchangeEntry } from "../../wire/types";
import { sheet } from "../app-state";
import { StopJob } from "./jobs";
import { type Model, viewOnly } from "./model";
import { server } from "./api";
import { question } from "./view-state";

/** The newest entries on screen; older ones are loaded by hand. */
const SHOWN = 400;
const BYTES_SHOWN = 14;

/** What is looked for in the log. */
interface Wanted {
  readonly text: Signal<string>;
  readonly way: Signal<"all" | "tx" | "rx">;
}

export function Exchange({ model }: { readonly model: Model | undefined }) {
  const filtering = useSignal(false);
  const byHand = useSignal(false);
  const wanted: Wanted = { text: useSignal(""), way: useSignal("all") };
  return (
    <aside class={`side ${sheet.value === "side" ? "open" : ""}`} id="side" aria-label="Exchange">
      <div class="head">
        <h2>Exchange</h2>
        <span>both directions</span>
        <span class="grow" />
        <button type="button" class="btn" aria-pressed={filtering.value} onClick={() => (filtering.value = !filtering.value)}>
          Filter
        </button>
        <button type="button" class="btn" aria-pressed={byHand.value} disabled={viewOnly.value} onClick={() => (byHand.value = !byHand.value)}>
          Send hex
        </button>
      </div>
      {filtering.value && <Filter wanted={wanted} />}
      {byHand.value && model && <ByHand model={model} />}
      {model && <Log model={model} wanted={wanted} />}
      {model && <Queue model={model} />}
    </aside>
  );
}

function Filter({ wanted: { text, way: ways } }: { readonly wanted: Wanted }) {
  return (
    <div class="exfilter">
      <label class="field">
        <span class="vh">Show only entries with</span>
        <input type="search" placeholder="Name, bytes or words" value={text.value} onInput={(event) => (text.value = event.currentTarget.value)} />
      </label>
      <span class="seg small" role="group" aria-label="Direction">
        {(["all", "tx", "rx"] as const).map((way) => (
          <button type="button" key={way} aria-pressed={ways.value === way} onClick={() => (ways.value = way)}>
            {{ all: "Both", tx: "Sent", rx: "Received" }[way]}
          </button>
        ))}
      </span>
    </div>
  );
}

/** Does an entry have these letters in its name, its words or its bytes? */
export function matches(entry: ExchangeEntry, text: string): boolean {
  const wanted = text.trim().toLowerCase();
  if (wanted === "") return true;
  return entry.name.toLowerCase().includes(wanted) || entry.text.toLowerCase().includes(wanted) || (/^[0-9a-f\s]+$/.test(wanted) && entry.hex.includes(wanted.replace(/\s/g, "")));
}

function Log({ model, wanted: { text: filter, way: ways } }: { readonly model: Model; readonly wanted: Wanted }) {
  const opened = useSignal<number | undefined>(undefined);
  const box = useRef<HTMLDivElement>(null);
  const follows = useRef(true);
  const place = useRef(0);
  const entries = model.exchange.value.filter((entry) => (ways.value === "all" || entry.way === ways.value) && matches(entry, filter.value)).slice(-SHOWN);
  useLayoutEffect(() => {
    if (follows.current && box.current) box.current.scrollTop = box.current.scrollHeight;
  });
  const onScroll = (): void => {
    const at = box.current;
    if (!at) return;
    // Only a person scrolls back; entries that come move the end, not the place.
    if (at.scrollHeight - at.scrollTop - at.clientHeight < 40) follows.current = true;
    else if (at.scrollTop < place.current) follows.current = false;
    place.current = at.scrollTop;
  };
  return (
    <div class="logbox" ref={box} onScroll={onScroll} tabIndex={0} role="region" aria-label="Log of the exchange">
      {!model.noOlder.value && model.exchange.value.length > 0 && (
        <button type="button" class="btn small earlier" onClick={() => void model.loadOlder()}>
          Earlier
        </button>
      )}
      {entries.length === 0 && <p class="dim exnone">{model.exchange.value.length > 0 ? "No entry has these letters." : "Nothing was sent to this device yet."}</p>}
      <ol class="log">
        {entries.map((entry) => (
          <Entry key={entry.seq} entry={entry} model={model} opened={opened} />
        ))}
      </ol>
    </div>
  );
}

interface EntryProps {
  readonly entry: ExchangeEntry;
  readonly model: Model;
  /** The entry that is open, by its number. */
  readonly opened: Signal<number | undefined>;
}

function Entry({ entry, model, opened }: EntryProps) {
  const open = opened.value === entry.seq;
  if (entry.way === "note") return <li class={`ex day ${entry.level === "info" ? "" : "alt"}`}><Message text={entry.text} /></li>;
  const sent = entry.way === "tx";
  const toggle = (): void => {
    opened.value = open ? undefined : entry.seq;
  };
  return (
    <li class={`ex ${sent ? "out" : "in"} ${entry.level === "info" ? "" : "alt"}`}>
      <time>{clock(entry.time, 3)}</time>
      <Icon name={sent ? "right" : "left"} />
      <div>
        <button type="button" class="exname" aria-expanded={open} onClick={toggle}>
          <span class="vh">{sent ? "sent " : "received "}</span>
          <b>{entry.name || "bytes"}</b>
        </button>
        {entry.ms !== null && (
          <span class="ms">
            {number(entry.ms, entry.ms < 10 ? 1 : 0)}
            <span class="u">ms</span>
          </span>
        )}
        <span class={`mono ${open ? "whole" : ""}`}>{spaced(entry.hex.replace("…", ""), open ? Infinity : BYTES_SHOWN)}</span>
        {entry.text !== "" && <span class="say"><Message text={entry.text} /></span>}
        {open && sent && (
          <button type="button" class="btn small edge" disabled={viewOnly.value} onClick={() => sendBytes(model, entry.hex, entry.name)}>
            Send again
          </button>
        )}
      </div>
    </li>
  );
}

/** Bytes as they are, asked once more: nobody checks them. */
function sendBytes(model: Model, bytes: string, name: string): void {
  question.value = {
    title: name ? `Send ${name} again?` : "Send these bytes?",
    words: ["Bytes sent by hand are checked by nobody; they may change anything in the device.", spaced(bytes, 48)],
    caution: "",
    go: "Send",
    act: () => void model.run(server.raw(model.id, bytes)),
  };
}

/** Raw hex, behind a deliberate switch. */
function ByHand({ model }: { readonly model: Model }) {
  const hex = useSignal("");
  const plain = hex.value.replace(/\s/g, "").toLowerCase();
  const why = plain === "" ? "" : !/^[0-9a-f]*$/.test(plain) ? "Only hex digits: 0 to 9, A to F." : plain.length % 2 ? "Two hex digits for each byte." : "";
  return (
    <form
      class="byhand"
      onSubmit={(event) => {
        event.preventDefault();
        if (plain !== "" && why === "") sendBytes(model, plain, "");
      }}
    >
      <label class="field">
        <span class="vh">Bytes to send, hex</span>
        <input class="mono" type="text" placeholder="FA FF 30 00 D1" value={hex.value} autocomplete="off" spellcheck={false} aria-invalid={why !== ""} aria-describedby="byhand-why" onInput={(event) => (hex.value = event.currentTarget.value)} />
      </label>
      <button type="submit" class="btn edge" disabled={plain === "" || why !== ""}>
        Send
      </button>
      <p id="byhand-why" class={why ? "why-not" : "dim"}>
        {why || "Sent as they are: no checksum is added, nothing is checked."}
      </p>
    </form>
  );
}

/** What runs and what waits. */
function Queue({ model }: { readonly model: Model }) {
  const control = model.control.value;
  const waiting = control?.queue ?? [];
  const running = control?.running;
  return (
    <div class="queue">
      {running && (
        <p>
          <span class="dot live" />
          <span class="grow ell">
            {running.title}
            {running.step ? `: ${running.step}` : ""}
          </span>
          <StopJob model={model} job={running} />
        </p>
      )}
      {waiting.map((job) => (
        <p key={job.id}>
          <span class="dot off" />
          <span class="grow ell">{job.title}</span>
          <StopJob model={model} job={job} />
        </p>
      ))}
      {!running && waiting.length === 0 && (
        <p>
          <span class="dot off" />
          Queue empty. One command at a time per device.
        </p>
      )}
    </div>
  );
}
