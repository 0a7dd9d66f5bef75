/** Every frame to and from the device, its meaning and duration; bytes by hand. */
import { type Signal, useSignal, computed, effect, type ReadonlySignal, signal } from "@preact/signals";
import { useCallback, useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { spaced } from "../../forms/frame-chips";
import { Button } from "../../ui/controls/button";
import { Segmented } from "../../ui/controls/choices";
import { clock, number } from "../../ui/format/format";
import { Icon } from "../../ui/controls/icons";
import { Message } from "../../ui/controls/message";
import type { TrafficEntry } from "../../wire/types";
import type { Model } from "../../pages/configure/model";
import type { Slots } from "../../extension/extension";
import { request } from "../../requests/http";
import { COMMON } from "../../texts/common";
import { TEXT as CONFIGURE } from "../../texts/configure";
import { TEXT } from "./texts";
import { madeFor } from "../../page/app-state";
import "./traffic.css";

/** The newest entries on screen; older ones are loaded by hand. */
const MAX_ROWS = 400;
const BYTES_SHOWN = 14;

/** Search in the log. */
interface Wanted {
  readonly text: Signal<string>;
  readonly direction: Signal<"all" | "tx" | "rx">;
}

export function TrafficLog({ model }: Slots["configureSide"]) {
  const filtering = useSignal(false);
  const byHand = useSignal(false);
  const wanted: Wanted = { text: useSignal(""), direction: useSignal("all") };
  return (
    <>
      <div class="head">
        <h2>{COMMON.trafficLog}</h2>
        <span>{TEXT.bothDirections}</span>
        <span class="grow" />
        <Button
          words={TEXT.filter}
          aria-pressed={filtering.value}
          onClick={() => (filtering.value = !filtering.value)}
        />
        <Button
          changes
          words={TEXT.sendHex}
          aria-pressed={byHand.value}
          onClick={() => (byHand.value = !byHand.value)}
        />
      </div>
      {filtering.value && <Filter wanted={wanted} />}
      {byHand.value && model && <ByHand model={model} />}
      {model && <Log model={model} wanted={wanted} />}
    </>
  );
}

function Filter({ wanted: { text, direction } }: { readonly wanted: Wanted }) {
  return (
    <div class="log-filter">
      <label class="field">
        <span class="visually-hidden">{TEXT.filterLabel}</span>
        <input
          type="search"
          placeholder={TEXT.filterPlaceholder}
          value={text.value}
          onInput={(event) => (text.value = event.currentTarget.value)}
        />
      </label>
      <Segmented
        label={TEXT.direction}
        class="small"
        value={direction.value}
        options={[
          ["all", TEXT.both],
          ["tx", CONFIGURE.sent],
          ["rx", TEXT.received],
        ]}
        onChoose={(way) => (direction.value = way)}
      />
    </div>
  );
}

/** Whether an entry has this text in its name, its words or its bytes. */
function matches(entry: TrafficEntry, text: string): boolean {
  const wanted = text.trim().toLowerCase();
  if (wanted === "") return true;
  return (
    entry.name.toLowerCase().includes(wanted) ||
    entry.text.toLowerCase().includes(wanted) ||
    (/^[0-9a-f\s]+$/.test(wanted) && entry.hex.includes(wanted.replace(/\s/g, "")))
  );
}

function Log({ model, wanted: { text: filter, direction } }: { readonly model: Model; readonly wanted: Wanted }) {
  const log = logOf(model);
  const opened = useSignal<number | undefined>(undefined);
  const box = useRef<HTMLDivElement>(null);
  const follows = useRef(true);
  const place = useRef(0);
  const entries = log.entries.value
    .filter(
      (entry) => (direction.value === "all" || entry.direction === direction.value) && matches(entry, filter.value),
    )
    .slice(-MAX_ROWS);
  const follow = useCallback(() => {
    if (follows.current && box.current) box.current.scrollTop = box.current.scrollHeight;
  }, []);
  useLayoutEffect(follow);
  useEffect(() => {
    const resized = new ResizeObserver(follow); // what stands under it grows with the queue
    if (box.current) resized.observe(box.current);
    return () => resized.disconnect();
  }, [follow]);
  const onScroll = (): void => {
    const at = box.current;
    if (!at) return;
    // only the user scrolls back; new entries move the end, not the position
    if (at.scrollHeight - at.scrollTop - at.clientHeight < 40) follows.current = true;
    else if (at.scrollTop < place.current) follows.current = false;
    place.current = at.scrollTop;
  };
  return (
    <div class="log-box" ref={box} onScroll={onScroll} tabIndex={0} role="region" aria-label={COMMON.trafficLog}>
      {!log.noOlder.value && log.entries.value.length > 0 && (
        <Button look="small earlier" words={TEXT.earlier} onClick={() => void log.loadOlder()} />
      )}
      {entries.length === 0 && (
        <p class="dim log-empty text-sm">{log.entries.value.length > 0 ? TEXT.noFilterMatch : TEXT.noTraffic}</p>
      )}
      <ol class="log">
        {entries.map((entry) => (
          <Entry key={entry.seq} entry={entry} model={model} opened={opened} />
        ))}
      </ol>
    </div>
  );
}

interface EntryProps {
  readonly entry: TrafficEntry;
  readonly model: Model;
  readonly opened: Signal<number | undefined>;
}

function Entry({ entry, model, opened }: EntryProps) {
  const open = opened.value === entry.seq;
  if (entry.direction === "note")
    return (
      <li class={`log-entry day ${entry.level === "info" ? "" : "alert"}`}>
        <Message text={entry.text} />
      </li>
    );
  const sent = entry.direction === "tx";
  const toggle = (): void => {
    opened.value = open ? undefined : entry.seq;
  };
  return (
    <li class={`log-entry ${sent ? "sent" : "received"} ${entry.level === "info" ? "" : "alert"}`}>
      <time>{clock(entry.time, 3)}</time>
      <Icon name={sent ? "right" : "left"} />
      <div>
        <button type="button" class="log-entry-name ellipsis" aria-expanded={open} onClick={toggle}>
          <span class="visually-hidden">{sent ? TEXT.sentPrefix : TEXT.receivedPrefix}</span>
          <b>{entry.name || TEXT.bytes}</b>
        </button>
        {entry.ms !== null && (
          <span class="duration">
            {number(entry.ms, entry.ms < 10 ? 1 : 0)}
            <span class="unit">ms</span>
          </span>
        )}
        <span class={`mono ${open ? "whole" : "ellipsis"}`}>
          {spaced(entry.hex.replace("…", ""), open ? Infinity : BYTES_SHOWN)}
        </span>
        {entry.text !== "" && (
          <span class="explanation">
            <Message text={entry.text} />
          </span>
        )}
        {open && sent && (
          <Button
            changes
            look="small edge"
            words={TEXT.sendAgain}
            onClick={() => void sendBytes(model, entry.hex, entry.name)}
          />
        )}
      </div>
    </li>
  );
}

const sendRaw = (device: string, hex: string, confirmed: boolean) =>
  request("POST /api/devices/{device}/raw", { path: { device }, body: { hex, confirmed } });

/** Send raw bytes; what is more than a request is named by the server, and asked about. */
async function sendBytes(model: Model, bytes: string, name: string): Promise<void> {
  const outcome = await sendRaw(model.writeName, bytes, false);
  if (outcome.ok || outcome.problem.kind !== "confirm") return void model.run(Promise.resolve(outcome));
  model.page.question.value = {
    title: name ? TEXT.confirmSendAgain(name) : TEXT.confirmSendBytes,
    about: model.fullName,
    words: [outcome.problem.message, spaced(bytes, 48)],
    caution: "",
    go: CONFIGURE.send,
    act: () => void model.run(sendRaw(model.writeName, bytes, true)),
  };
}

/** Raw hex, behind a deliberate switch. */
function ByHand({ model }: { readonly model: Model }) {
  const hex = useSignal("");
  const plain = hex.value.replace(/\s/g, "").toLowerCase();
  const why =
    plain === ""
      ? ""
      : !/^[0-9a-f]*$/.test(plain)
        ? COMMON.hexDigitsOnly
        : plain.length % 2
          ? COMMON.twoDigitsPerByte
          : "";
  return (
    <form
      class="send-bytes"
      onSubmit={(event) => {
        event.preventDefault();
        if (plain !== "" && why === "") void sendBytes(model, plain, "");
      }}
    >
      <label class="field">
        <span class="visually-hidden">{TEXT.bytesToSend}</span>
        <input
          class="mono"
          type="text"
          placeholder={TEXT.bytesPlaceholder}
          value={hex.value}
          autocomplete="off"
          spellcheck={false}
          aria-invalid={why !== ""}
          aria-describedby="byhand-why"
          onInput={(event) => (hex.value = event.currentTarget.value)}
        />
      </label>
      <Button changes type="submit" look="edge" words={CONFIGURE.send} disabled={plain === "" || why !== ""} />
      <p id="byhand-why" class={why ? "why-not" : "dim"}>
        {why || TEXT.sentUnchanged}
      </p>
    </form>
  );
}

/** Entries that are loaded at once. */
const OLDER_BY = 200;

class TrafficState {
  readonly #older: Signal<readonly TrafficEntry[]> = signal([]);
  readonly noOlder = signal(false);
  readonly entries: ReadonlySignal<readonly TrafficEntry[]>;

  constructor(readonly model: Model) {
    const { id, store } = model;
    this.entries = computed(() => {
      const own = store.traffic.value.filter(({ device }) => device === id);
      const known = new Set(own.map(({ seq }) => seq)); // entries missed while disconnected lie between them
      return [...this.#older.value.filter(({ seq }) => !known.has(seq)), ...own].sort((a, b) => a.seq - b.seq);
    });
    // another sensor on this link has a log of its own
    const sensor = computed(() => (model.device.value?.serial_number ? model.device.value.key : ""));
    let before = sensor.peek();
    effect(() => {
      if (sensor.value === "") return;
      if (before !== "" && sensor.value !== before) this.#forget();
      before = sensor.value;
    });
    effect(() => {
      if (store.jobs.value.size === 0) this.#forget(); // another run of the server renumbers entries
    });
    effect(() => {
      if (model.loads.value > 0) void this.loadOlder(undefined);
    });
  }

  #forget(): void {
    this.#older.value = [];
    this.noOlder.value = false;
  }

  async loadOlder(before = this.entries.peek()[0]?.seq): Promise<void> {
    const query = { before, limit: OLDER_BY };
    const found = await request("GET /api/devices/{device}/traffic", { path: { device: this.model.id }, query });
    if (!found.ok) return;
    this.noOlder.value = found.value.length < OLDER_BY;
    const known = new Set(this.#older.peek().map(({ seq }) => seq));
    this.#older.value = [...found.value.filter(({ seq }) => !known.has(seq)), ...this.#older.peek()].sort(
      (a, b) => a.seq - b.seq,
    );
  }
}

const logOf = madeFor((model: Model) => new TrafficState(model));
