/**
 * A recording that is open: where it is read, what is on screen, and the samples for both.
 *
 *     head, speed, loop ──▶ view, cursor (the same signals as on Live) ──▶ plots, panels
 *                             │
 *                             ├─ the window, as finely as the screen ──▶ Screen ──▶ store `drawn`   what plots draw
 *                             ├─ samples around the cursor, as they came ──▶ Vicinity ──▶ store `near`   what is read
 *                             └─ samples around the measuring cursor ──▶ Vicinity ──▶ store `far`        what it is measured against
 *
 * `near` tells of the devices as they were at the head: its clock is the head, its events are those that had happened by then.
 */
import { computed, effect, type Signal, signal } from "@preact/signals";
import type { Ring } from "../data/ring-buffer";
import type { Stats } from "../data/statistics";
import type { Channel } from "../data/channels";
import { cursor, frame, hidden, measure, normsSeen, view } from "../data/view-state";
import { Minute } from "../panels/health-history";
import { type Reading, readingAt } from "../panels/cursor-time";
import { asked } from "../plots/plot-stack";
import type { App } from "../pages/app-state";
import type { Problem } from "../ui/http";
import type { PageState } from "../ui/page-state";
import { type Place, seriesOf, takeSeries } from "./permalink";
import { FaredFeed, minuteAt } from "./health-history";
import { healthAt, lostAfter, until } from "./health-at";
import { advance, begin, followed, type Playing } from "./playback";
import { ReplayStore } from "./replay-store";
import { Screen, type Shown } from "./visible-range";
import { changedStats, StatisticsFeed } from "./statistics-feed";
import type { Bounds } from "./time-range";
import type { Marker, RecordingDetail } from "./types";
import { Vicinity } from "./vicinity";

/** What a mean and a spread are told of (panels/value-groups.ts). */
const COUNTED: ReadonlySet<string> = new Set(["vector", "euler", "quaternion", "matrix", "scalar"]);
/** How often figures are told, as live. */
const TOLD_PER_S = 2;

export class Replay {
  readonly drawn: ReplayStore;
  readonly near: ReplayStore;
  readonly far: ReplayStore;
  readonly app: App;
  readonly bounds: Bounds;
  readonly markers = signal<readonly Marker[]>([]);
  readonly playing = signal(false);
  readonly speed = signal(1);
  readonly loop = signal<readonly [number, number] | undefined>(undefined);
  readonly looping = signal(false);
  readonly follow = signal(true);
  readonly problem: Signal<Problem | undefined>;
  /** How much of it is decoded, 0..1. */
  readonly progress = signal(1);
  /** Where it is read, unix s. Changes with every frame: not a signal. */
  head: number;
  readonly #screen: Screen;
  readonly #fared: FaredFeed;
  readonly #minute = new Minute();
  readonly #statistics: StatisticsFeed;
  readonly #read: Vicinity;
  readonly #measured: Vicinity;
  #frame = NaN;
  readonly #unframe: () => void;
  #told = "";
  readonly #before = { view: view.peek(), cursor: cursor.peek(), measure: measure.peek(), hidden: hidden.peek(), asked: asked.peek() };

  /** @param screen of this recording, where it was prepared */
  constructor(
    readonly detail: RecordingDetail,
    place: Place,
    screen = new Screen(detail),
  ) {
    this.#screen = screen;
    this.bounds = screen.bounds;
    this.head = this.bounds.first;
    this.drawn = screen.store;
    this.problem = screen.problem;
    this.near = new ReplayStore(detail, () => this.head);
    this.far = new ReplayStore(detail, () => this.head);
    this.#fared = new FaredFeed(detail.info.id, this.bounds);
    this.#statistics = new StatisticsFeed(detail.info.id);
    const told = (problem: Problem): void => void (this.problem.value = problem);
    this.#read = new Vicinity(detail, this.near, this.bounds, told);
    this.#measured = new Vicinity(detail, this.far, this.bounds, told);
    this.#unframe = effect(() => [this.drawn, this.near, this.far].forEach((store) => store.showIn(frame.value)));
    this.markers.value = detail.markers;
    this.progress.value = detail.progress;
    this.app = { ...appOf(this.near, this.#minute), allEvents: detail.events, jump: ({ t0 }) => this.seek(t0), statistics: (channel, column, at) => this.#statisticsOf(channel, column, at), lostLater: (of) => lostAfter(detail.events, of, this.head) };
    this.go(place);
    this.#screen.want(this.#shown); // at once: before anything is drawn
  }

  /** Width of the plots, px. */
  set pixels(width: number) {
    this.#screen.pixels = width;
  }

  /** Is what is on screen here, as finely as the screen can show it? */
  get isShown(): boolean {
    return this.#screen.has(this.#shown);
  }

  get #shown(): Shown {
    const { end, span, device, timeBase: base } = view.peek();
    return { device, t0: end - span, t1: end, base, speed: this.playing.peek() && this.follow.peek() ? this.speed.peek() : 0 };
  }

  /** Show a place; what it does not say is the whole recording and its first device. */
  go(place: Place): void {
    const { first, last } = this.bounds;
    const known = this.detail.devices.some(({ id }) => id === place.device);
    const device = known ? place.device : this.detail.devices[0]?.id;
    const [t0, t1] = [place.t0 ?? first, place.t1 ?? last];
    if (place.loop) [this.loop.value, this.looping.value] = [place.loop, true];
    if (place.hide.length + place.show.length > 0) hidden.value = takeSeries(place, normsSeen);
    if (place.panels.length > 0) asked.value = new Set(place.panels);
    if (place.frame) frame.value = place.frame;
    measure.value = place.measure;
    view.value = { device, live: false, end: t1, span: Math.max(t1 - t0, 0.005), timeBase: place.base ?? "device" };
    this.#put(Math.min(Math.max(place.cursor ?? t0, first), last));
  }

  /** More of it is decoded. False where that is more than samples (a channel, a device, the end): then it is to be opened anew. */
  grow({ devices, channels, t0, t1, progress }: RecordingDetail): boolean {
    const now = this.detail;
    if (progress === 1 || devices.length !== now.devices.length || channels.length !== now.channels.length || t0 !== now.t0 || t1 !== now.t1) return false;
    this.progress.value = progress;
    this.#screen.refresh();
    for (const one of [this.#read, this.#measured, this.#fared, this.#statistics]) one.refresh();
    return true;
  }

  /** Opened anew: the same place, played on as this one was. */
  reopened(detail: RecordingDetail): Replay {
    const { t0, t1, ...rest } = this.place();
    const whole = t0 !== undefined && t1 !== undefined && t0 <= this.bounds.first && t1 >= this.bounds.last;
    const [playing, speed, follow] = [this.playing.peek(), this.speed.peek(), this.follow.peek()];
    this.dispose();
    const next = new Replay(detail, whole ? rest : { ...rest, ...(t0 !== undefined ? { t0 } : {}), ...(t1 !== undefined ? { t1 } : {}) });
    [next.playing.value, next.speed.value, next.follow.value] = [playing, speed, follow];
    return next;
  }

  /** What a link to what is on screen carries. */
  place(): Place {
    const { end, span, device, timeBase } = view.peek();
    const loop = this.loop.peek();
    return {
      t0: end - span, t1: end, cursor: this.head,
      ...(loop && this.looping.peek() ? { loop } : {}),
      ...(device !== undefined ? { device } : {}),
      ...(measure.peek() === undefined ? {} : { measure: measure.peek()! }),
      ...(frame.peek() === undefined ? {} : { frame: frame.peek()! }),
      base: timeBase,
      ...seriesOf(hidden.peek(), normsSeen),
      panels: [...asked.peek()],
    };
  }

  toggle(): void {
    if (this.playing.peek()) {
      this.playing.value = false;
      return;
    }
    const next = begin(this.#state(), this.bounds);
    this.seek(next.head);
    this.playing.value = true;
  }

  /** Read there; the window follows when that is not on screen. */
  seek(t: number): void {
    const { first, last } = this.bounds;
    const to = Math.min(last, Math.max(first, t));
    const { end, span } = view.peek();
    if (to < end - span || to > end) view.value = { ...view.peek(), end: followed(end, span, this.head, to) };
    this.#put(to);
  }

  /** Loop what is on screen, or no longer loop. */
  toggleLoop(): void {
    if (this.looping.peek()) {
      this.looping.value = false;
      return;
    }
    const { end, span } = view.peek();
    this.loop.value = [Math.max(end - span, this.bounds.first), Math.min(end, this.bounds.last)];
    this.looping.value = true;
  }

  choose(device: string): void {
    view.value = { ...view.peek(), device };
  }

  /** Once a frame; `now` in ms. */
  tick(now: number): void {
    const seconds = Math.min(0.25, (now - this.#frame) / 1000); // a tab that slept goes on where it was
    this.#frame = now;
    const at = cursor.peek();
    if (at?.kind === "pinned" && at.time !== this.head) this.head = at.time; // somebody pressed on a plot or stepped
    if (this.playing.peek()) this.#advance(seconds);
    this.#screen.want(this.#shown);
    // What is drawn comes first; what is read of it a moment later.
    if (this.#screen.held || this.problem.peek()) this.#around(now);
    this.#tell();
  }

  /** Milliseconds from the last request for the window to its samples in their rings. */
  get took(): number {
    return this.#screen.took;
  }

  dispose(): void {
    this.#unframe();
    this.#screen.dispose();
    for (const one of [this.#read, this.#measured, this.#fared, this.#statistics]) one.dispose();
    view.value = this.#before.view;
    cursor.value = this.#before.cursor?.kind === "pinned" ? this.#before.cursor : undefined;
    measure.value = this.#before.measure;
    hidden.value = this.#before.hidden;
    asked.value = this.#before.asked;
  }

  #state(): Playing {
    return { head: this.head, playing: this.playing.peek(), speed: this.speed.peek(), loop: this.loop.peek(), looping: this.looping.peek() };
  }

  #put(t: number): void {
    this.head = t;
    cursor.value = { kind: "pinned", time: t };
  }

  #advance(seconds: number): void {
    const was = this.head;
    const next = advance(this.#state(), seconds, this.bounds);
    this.#put(next.head);
    if (next.playing !== this.playing.peek()) this.playing.value = next.playing;
    const { end, span } = view.peek();
    const whole = span >= this.bounds.last - this.bounds.first;
    if (this.follow.peek() && !whole) view.value = { ...view.peek(), end: followed(end, span, was, next.head) };
  }

  /** The store that holds a channel's samples as they came at `t`: around the cursor, or around the measuring one. */
  reads(channel: Channel, t: number): Channel {
    const store = t === measure.peek() ? this.far : this.near;
    return store.channel(channel.info.device, channel.info.name) ?? channel;
  }

  /** Of the window: from its samples where they are all here, else as the server counted them. */
  #statisticsOf(channel: Channel, column: number, { from, to }: Reading): Stats | undefined {
    const base = view.peek().timeBase;
    const ring = this.#every(channel, from, to);
    if (ring) return ring.stats(column, from, to, base);
    const { device } = channel.info;
    const told = this.detail.channels.filter((info) => info.device === device && COUNTED.has(info.kind)).map(({ id }) => id);
    this.#statistics.want({ channels: told, from: Math.max(from, this.bounds.first), to: Math.min(to, this.bounds.last), base });
    return changedStats(this.near.changeOf(channel.info.id)?.[column], column, channel.info.columns[column]?.period ?? 0, (k) => this.#statistics.of(channel.info.id, k));
  }

  /** Where a channel's samples of the window are all there: what is drawn, when that is not summarised, or what is read. */
  #every({ info, ring }: Channel, from: number, to: number): Ring | undefined {
    const { held } = this.#screen;
    const whole = held?.exact && held.stretch.t0 <= Math.max(from, this.bounds.first) && held.stretch.t1 >= Math.min(to, this.bounds.last);
    const drawn = whole ? this.drawn.channel(info.device, info.name)?.ring : undefined;
    if (drawn && drawn.length > 0) return drawn;
    return this.#read.isWhole(info.id, from, to) ? ring : undefined;
  }

  /** Have the samples around what is read, and around what it is measured against. */
  #around(now: number): void {
    const { device, timeBase: base } = view.peek();
    const { time } = readingAt(view.peek(), cursor.peek(), this.head);
    const other = measure.peek();
    this.#read.around({ device, time, base, speed: this.playing.peek() ? this.speed.peek() : 0 }, now);
    if (other !== undefined) this.#measured.around({ device, time: other, base, speed: 0 }, now);
  }

  /** Events and figures as they stood at the head. */
  #tell(): void {
    const { device } = view.peek();
    const happened = until(this.detail.events, this.head);
    const fared = device === undefined ? undefined : this.#fared.at(device, this.head);
    const state = `${happened.length} ${device} ${this.#fared.version} ${Math.floor(this.head * TOLD_PER_S)}`;
    if (state === this.#told) return;
    this.#told = state;
    if (happened.length !== this.near.events.peek().length) this.near.events.value = happened;
    if (device === undefined) return;
    this.near.health.value = new Map([[device, healthAt(this.detail, device, this.head, fared)]]);
    if (fared) this.#minute.put(device, minuteAt(fared, happened, device, this.head));
  }
}

/** The recording as the panels know the page: always with something on screen, and never old. */
function appOf(store: ReplayStore, minute: Minute): App {
  const device = computed(() => store.devices.value.find(({ id }) => id === view.value.device));
  const state = signal<PageState>("live");
  return { store, minute, device, state, held: () => false };
}
