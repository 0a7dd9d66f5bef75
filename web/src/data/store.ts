/**
 * State of the page: devices, channels, health and events as signals (small, rare, reactive) and samples in rings (large, frequent,
 * never reactive). Everything comes from the socket worker as `FromWorker` messages through `receive`, which a benchmark or a test
 * can call as well.
 *
 *     worker ──frames──▶ receive ──▶ Backfill, while a gap is filled ──▶ appendFrame ──▶ Channels: rings of what is sent and derived
 *                           └──text──▶ signals
 *
 * After a lost connection the worker requests only the missed seconds. Later frames are held back (`Backfill`) until the
 * server sends `history_end`, and are put into the rings in order: known sample numbers are skipped. A restarted server numbers
 * from 1 again: data of devices that come back is kept (`Past`), and the new data follows it.
 */
import { signal, type Signal } from "@preact/signals";
import { capabilities, isViewOnly } from "../wire/capabilities";
import { localNow } from "../wire/clock";
import type { SampleFrame } from "../wire/codec";
import type { FromWorker, ToWorker } from "../wire/worker-messages";
import type {
  ChannelInfo,
  DeviceJobs,
  DeviceHealth,
  DeviceInfo,
  EventInfo,
  TrafficEntry,
  ExportJob,
  UnknownPayload,
  RecorderState,
  ServerText,
} from "../wire/types";
import { ChannelRegistry, type Channel } from "./channels";
import type { WorldFrame } from "./rotations";
import type { FrameChange } from "./frames";
import { LossList, type Loss } from "./losses";
import { Past } from "./past";
import { PageDelays, type BehindBy } from "./behind";
import { Budget, Ring } from "./ring-buffer";

/** Longest wait for a refill: a plot that stands still is worse than one with a gap. */
const REFILL_S = 3;

interface Waiting {
  readonly history: SampleFrame[];
  readonly live: SampleFrame[];
  readonly timer: ReturnType<typeof setTimeout>;
}

/**
 * Holds frames back after a reconnect until the gap before them is filled.
 *
 *     begin ──▶ take: frames wait ──▶ end, when the server has sent the missed part, or after `REFILL_S`
 *                                      └──▶ keep: the missed part, oldest block first, then the frames held back
 */
class Backfill {
  readonly #keep: (frame: SampleFrame) => void;
  #waiting: Waiting | undefined;

  /** @param keep receives the frames after the wait */
  constructor(keep: (frame: SampleFrame) => void) {
    this.#keep = keep;
  }

  /** Start holding frames back. */
  begin(): void {
    this.end();
    this.#waiting = { history: [], live: [], timer: setTimeout(() => this.end(), 1000 * REFILL_S) };
  }

  /** Take a frame; it is held back during a refill. */
  take(frame: SampleFrame): void {
    if (this.#waiting !== undefined) (frame.history ? this.#waiting.history : this.#waiting.live).push(frame);
    else this.#keep(frame);
  }

  /** Put held frames into the rings: history came newest block first, so it goes in backwards. */
  end(): void {
    const waiting = this.#waiting;
    if (waiting === undefined) return;
    this.#waiting = undefined;
    clearTimeout(waiting.timer);
    for (const frame of waiting.history.reverse()) this.#keep({ ...frame, history: false });
    for (const frame of waiting.live) this.#keep(frame);
  }
}

/** Seconds of history requested at most. The server and the budget of the rings may hold less. */
const HISTORY_S = 3600;
/** A device may be away this long after a server restart for its data to be kept. */
const PAST_S = 120;
const EVENTS_KEPT = 10_000;
const TRAFFIC_KEPT = 2000;

/** Whether a device's clock restarted or jumped, so that lines must break. */
function isStep({ kind, device }: EventInfo): boolean {
  return kind === "clock" && device !== "";
}

/** Whether samples were lost in a known interval. */
function isLoss({ kind, t0, t1 }: EventInfo): boolean {
  return kind === "gap" && t0 !== null && t1 !== null;
}

export class Store {
  readonly #channels = new ChannelRegistry((info) => this.#ring(info));
  readonly channels: Signal<readonly Channel[]> = this.#channels.living;
  readonly devices: Signal<readonly DeviceInfo[]> = signal([]);
  readonly health: Signal<ReadonlyMap<string, DeviceHealth>> = signal(new Map());
  readonly events: Signal<readonly EventInfo[]> = signal([]);
  /** The newest payload of every undescribed kind. */
  readonly unknownPayloads: Signal<readonly UnknownPayload[]> = signal([]);
  /** Activity on each device: jobs, queue, rollback. */
  readonly jobs: Signal<ReadonlyMap<string, DeviceJobs>> = signal(new Map());
  /** Frames to and from devices since this page was opened, all devices together; older ones come over HTTP. */
  readonly traffic: Signal<readonly TrafficEntry[]> = signal([]);
  /** State of the recorder; undefined until received. */
  readonly recorder: Signal<RecorderState | undefined> = signal(undefined);
  /** Incremented whenever the list of recordings has changed. */
  readonly library: Signal<number> = signal(0);
  readonly exports: Signal<readonly ExportJob[]> = signal([]);
  readonly connection: Signal<"connecting" | "open" | "closed"> = signal("connecting");
  /** Start of silence on an open connection, unix s by the server's clock; undefined while messages arrive. */
  readonly silentSince: Signal<number | undefined> = signal(undefined);
  /** Time of the next connection attempt, unix s by the server's clock; undefined while open. */
  readonly nextTry: Signal<number | undefined> = signal(undefined);
  /** The last unreadable or refused message. */
  readonly problem: Signal<string | undefined> = signal(undefined);
  /** Round trip to the server, s; undefined until the first is measured. */
  readonly roundTrip: Signal<number | undefined> = signal(undefined);
  /** True from a subscription until its history is complete. */
  readonly filling: Signal<boolean> = signal(false);

  readonly #delays = new PageDelays();
  #losses = new LossList();
  /** Data held when the server began another run, until its devices come back. */
  #past: Past | undefined;
  #pastEnds: ReturnType<typeof setTimeout> | undefined;
  /** Devices that came back with another run of the server and have sent nothing yet: last arrival, unix s. */
  readonly #away = new Map<string, number>();
  #budget = new Budget();
  #worker: Worker | undefined;
  readonly #backfill = new Backfill((frame) => this.appendFrame(frame));
  #offset = 0;
  /** How far off the server's clock can be, ± s; NaN before the first ping. */
  #uncertainty = NaN;

  /** Connect to `url` (ws:// or wss://) and stay connected. */
  start(url: string): void {
    this.stop();
    this.#worker = new Worker(new URL("../wire/socket-worker.ts", import.meta.url), { type: "module" });
    this.#worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.receive(data);
    this.#post({ kind: "start", url, history: HISTORY_S });
  }

  stop(): void {
    this.#post({ kind: "stop" });
    this.#worker?.terminate();
    this.#worker = undefined;
  }

  /** Request samples at most every `seconds`; 0: as often as possible. */
  requestInterval(seconds: number): void {
    this.#post({ kind: "interval", seconds });
  }

  /** Try the connection again now. */
  retry(): void {
    this.#post({ kind: "retry" });
  }

  /** Whether the server is unreachable: no connection, or a dead one. Displayed data is old. */
  get isCut(): boolean {
    return this.connection.value !== "open" || this.silentSince.value !== undefined;
  }

  /**
   * Right edge of a device's live data, unix s: now; or its last sample, if it is a file that has ended at any time,
   * if what is shown is behind, or if the server is gone: figures of a window are held, as its samples are.
   */
  edgeOf(device: string | undefined): number {
    const now = this.serverNow();
    const status = this.devices.peek().find(({ id }) => id === device)?.status;
    const isCut = this.connection.peek() !== "open" || this.silentSince.peek() !== undefined;
    if (
      !isCut &&
      status !== "ended" &&
      !(status === "live" && this.#delays.behind(device!, this.health.peek().get(device!), now).total > 0)
    )
      return now;
    let last = -Infinity;
    for (const { info, ring } of this.channels.peek())
      if (info.device === device && ring.length > 0) last = Math.max(last, ring.time(ring.length - 1));
    return last === -Infinity ? now : Math.min(now, last);
  }

  /** The server's clock, unix s. */
  serverNow(): number {
    return localNow() + this.#offset;
  }

  /** By how much what the page has of a device is behind. */
  behind(device: string): BehindBy {
    return this.#delays.behind(device, this.health.value.get(device), this.serverNow());
  }

  /** The living channel of that name, including derived ones. */
  channel(device: string, name: string): Channel | undefined {
    return this.channels.peek().find(({ info }) => info.device === device && info.name === name);
  }

  /** Samples dropped for this browser, all channels together. */
  dropped(): number {
    return this.#channels.dropped();
  }

  /** All known losses of a device, by start. */
  losses(device: string): readonly Loss[] {
    return this.#losses.of(device);
  }

  receive(message: FromWorker): void {
    switch (message.kind) {
      case "frames":
        for (const frame of message.frames) this.#onFrame(frame, message.received);
        return;
      case "text":
        return this.#onText(message.text);
      case "connection":
        this.connection.value = message.state;
        this.silentSince.value = undefined;
        this.nextTry.value = message.nextTry === undefined ? undefined : message.nextTry + this.#offset;
        return;
      case "silence":
        this.silentSince.value = message.since === undefined ? undefined : message.since + this.#offset;
        return;
      case "subscribed":
        return this.#onSubscribed(message.fresh);
      case "clock":
        this.#offset = message.offset;
        this.#uncertainty = message.uncertainty;
        return;
      case "round-trip":
        this.roundTrip.value = message.seconds;
        return;
      case "problem":
        this.problem.value = message.message;
        return;
    }
  }

  #post(message: ToWorker): void {
    this.#worker?.postMessage(message);
  }

  #onSubscribed(fresh: boolean): void {
    this.#backfill.end(); // one that never ended: its frames are older than what comes now
    this.filling.value = true;
    if (!fresh || !this.#channels.isEmpty) this.#backfill.begin();
    if (fresh) this.#beginRun();
  }

  /** Start a new run of the server: keep the data for devices that come back; reset everything else. */
  #beginRun(): void {
    const held = this.#channels.held();
    this.#forgetPast();
    if (held.length > 0) {
      this.#past = new Past(this.devices.peek(), held, this.#losses, this.events.peek());
      this.#pastEnds = setTimeout(() => this.#forgetPast(), 1000 * PAST_S);
    } else this.#budget = new Budget();
    this.#losses = new LossList();
    this.#away.clear();
    this.#delays.clear();
    this.#channels.clear();
    this.events.value = [];
    this.health.value = new Map();
    this.unknownPayloads.value = [];
    this.jobs.value = new Map();
    this.traffic.value = [];
  }

  #forgetPast(): void {
    clearTimeout(this.#pastEnds);
    this.#past?.release();
    this.#past = undefined;
  }

  /** Hand over the data of devices that have come back; take it back if the match was wrong. */
  #meetPast(devices: readonly DeviceInfo[]): void {
    const past = this.#past;
    if (past === undefined) return;
    for (const device of past.mistaken(devices)) {
      for (const ring of this.#channels.ringsOf(device)) ring.clear();
      this.#losses.forget(device);
      this.#away.delete(device);
      this.events.value = this.events.peek().filter((event) => event.device !== device || event.seq >= 0);
    }
    for (const device of past.meet(devices)) {
      this.#losses.addAll(device, past.lossesOf(device));
      this.#away.set(device, past.lastOf(device));
      this.events.value = [...past.eventsOf(device), ...this.events.peek()].sort((a, b) => a.seq - b.seq);
    }
  }

  #onText(text: ServerText): void {
    switch (text.op) {
      case "hello":
        capabilities.value = text.capabilities;
        isViewOnly.value = text.role === "view";
        if (!Number.isFinite(this.#uncertainty)) this.#offset = text.server_time - localNow();
        this.problem.value = undefined;
        return;
      case "devices":
        this.#meetPast(text.devices);
        this.devices.value = text.devices;
        return;
      case "channels":
        return this.#channels.add(text.channels);
      case "health":
        this.health.value = new Map(text.devices.map((health) => [health.device, health]));
        return;
      case "unknown_payloads":
        this.unknownPayloads.value = text.payloads;
        return;
      case "events":
        return this.#onEvents(text.events);
      case "jobs":
        this.jobs.value = new Map(text.devices.map((state) => [state.device, state]));
        return;
      case "traffic":
        this.traffic.value = [...this.traffic.peek(), ...text.entries].slice(-TRAFFIC_KEPT);
        return;
      case "recorder":
        this.recorder.value = text;
        return;
      case "library":
        this.library.value += 1;
        return;
      case "exports":
        this.exports.value = text.jobs;
        return;
      case "history_end":
        this.#backfill.end();
        this.filling.value = false;
        return;
      case "error":
        this.problem.value = text.hint ? `${text.message} ${text.hint}` : text.message;
        return;
      case "pong":
        return; // the worker keeps the clock
    }
  }

  #onEvents(events: readonly EventInfo[]): void {
    const last = this.events.peek().at(-1)?.seq ?? -Infinity;
    const fresh = events.filter(({ seq }) => seq > last); // a new subscription repeats what is known
    if (fresh.length === 0) return;
    this.#losses.addEvents(fresh);
    for (const { device, time } of fresh.filter(isStep))
      for (const ring of this.#channels.ringsOf(device)) ring.cut(time);
    for (const { device, t0, t1 } of fresh.filter(isLoss))
      for (const ring of this.#channels.ringsOf(device)) ring.lose(t0!, t1!);
    this.events.value = [...this.events.peek(), ...fresh].slice(-EVENTS_KEPT);
  }

  /** The world frame of a device's attitude; undefined without attitude. */
  nativeFrame(device: string): WorldFrame | undefined {
    return this.#channels.nativeFrame(device);
  }

  /** Display everything in that frame, or as sent; stored samples are converted. */
  showIn(frame: WorldFrame | undefined): void {
    this.#channels.showIn(frame);
  }

  /** Forget a channel that the server computes no more. */
  forgetChannel(device: string, name: string): void {
    this.#channels.remove(device, name);
  }

  /** The frame change of a channel; undefined if there is none. */
  changeOf(channel: number): FrameChange | undefined {
    return this.#channels.changeOf(channel);
  }

  /** The channel under that id as the device sends it, without what the page adds. */
  sent(id: number): ChannelInfo | undefined {
    return this.#channels.sent(id);
  }

  /** Whether another message of its device has sent a channel of that name, which is not displayed. */
  isShared(info: ChannelInfo): boolean {
    return this.#channels.isShared(info);
  }

  /** The ring of a new channel: the one from before a server restart, or an empty one. */
  #ring(info: ChannelInfo): Ring {
    const held = this.#past?.ringFor(info);
    held?.continueAnew();
    if (held) return held;
    const status = info.kind === "status";
    const ring = new Ring(
      info.columns.map(({ dtype, period, bits }) => ({ dtype, period, status: status && bits.length > 0 })),
      this.#budget,
    );
    for (const { device, time } of this.events.peek().filter(isStep)) if (device === info.device) ring.cut(time);
    for (const { t0, t1, by } of this.#losses.of(info.device)) if (by === "device") ring.lose(t0, t1);
    return ring;
  }

  #onFrame(frame: SampleFrame, received: number): void {
    this.#backfill.take(frame);
    const device = frame.history ? undefined : this.#channels.source(frame.channel)?.info.device;
    if (device !== undefined) this.#delays.note(device, frame.now, received, this.serverNow());
  }

  /** Put a frame into the rings of its channel. `bounds`: its rows are alternately the least and the greatest of intervals. */
  protected appendFrame(frame: SampleFrame, bounds = false): void {
    const source = this.#channels.source(frame.channel);
    if (source === undefined) return;
    const before = source.ring.newest;
    const { device } = source.info;
    if (this.#away.has(device)) {
      this.#losses.addRestart(device, this.#away.get(device)!, frame.arrival[0]!);
      this.#away.delete(device);
    }
    this.#channels.take(frame, bounds);
    if (frame.dropped > 0) this.#losses.addDrop(source.info, before, frame.arrival[0] ?? before, frame.dropped);
  }
}
