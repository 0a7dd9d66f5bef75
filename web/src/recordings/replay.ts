/**
 * A recording that is open: where it is read, what is on screen, and the samples for both.
 *
 *     head, speed, loop ──▶ view, cursor (the same signals as on Live) ──▶ plots, panels
 *                             │
 *                             ├─ the window, as finely as the screen ──▶ Screen ──▶ store `drawn`   what plots draw
 *                             └─ samples around the cursor, as they came ──▶ Feeds ──▶ store `near`     what is read
 *
 * `near` tells of the devices as they were at the head: its clock is the head, its events are those that had happened by then.
 */
import { computed, type Signal, signal } from "@preact/signals";
import type { Ring } from "../data/ring";
import type { Channel } from "../data/store";
import { cursor, hidden, measure, view } from "../data/view";
import { Minute } from "../panels/minute";
import { readingAt } from "../panels/reading";
import { asked } from "../plots/stack";
import type { App } from "../pages/app";
import type { Problem } from "../ui/api";
import type { PageState } from "../ui/state";
import type { Place } from "./address";
import { FaredFeed, minuteAt } from "./fared";
import { Feed } from "./feed";
import { healthAt, until } from "./figures";
import { advance, begin, followed, type Playing } from "./player";
import { ReplayStore } from "./replay-store";
import { Screen, type Shown } from "./screen";
import { type Bounds, type Near, nearOf } from "./stretch";
import type { Marker, RecordingDetail } from "./types";

/** Shortest reach of samples around the cursor, s. */
const LEAST_REACH_S = 0.02;
/** The server gives rows as they are when there are at most twice as many. */
const NEAR_WIDTH = 8000;

/** A value that is no longer that of the moment is shown at most this long, ms. */
const PATIENCE_MS = 400;
/** Played quickly, samples are asked for at most this far ahead, in seconds of a person's time. */
const LONGEST_LEAD_S = 0.5;

/** How often figures are told, as live. */
const TOLD_PER_S = 2;

interface Around {
  readonly near: Near;
  readonly feed: Feed;
  /** Share of the reach that is asked for: less where samples come too densely. */
  share: number;
  /** Since when what is read has not been among what is held, ms; NaN while it is. */
  missing: number;
}

export class Replay {
  readonly drawn: ReplayStore;
  readonly near: ReplayStore;
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
  #around: readonly Around[] = [];
  #aroundOf: string | undefined;
  #frame = NaN;
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
    this.#fared = new FaredFeed(detail.info.id, this.bounds);
    this.markers.value = detail.markers;
    this.progress.value = detail.progress;
    this.app = appOf(this.near, this.#minute, (channel, from, to) => this.#every(channel, from, to));
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
    if (place.hide.length > 0) hidden.value = new Set(place.hide);
    if (place.panels.length > 0) asked.value = new Set(place.panels);
    measure.value = undefined;
    view.value = { device, live: false, end: t1, span: Math.max(t1 - t0, 0.005), timeBase: place.base ?? "device" };
    this.#put(Math.min(Math.max(place.cursor ?? t0, first), last));
  }

  /** More of it is decoded. False where that is more than samples (a channel, a device, the end): then it is to be opened anew. */
  grow({ devices, channels, t0, t1, progress }: RecordingDetail): boolean {
    const now = this.detail;
    if (progress === 1 || devices.length !== now.devices.length || channels.length !== now.channels.length || t0 !== now.t0 || t1 !== now.t1) return false;
    this.progress.value = progress;
    this.#screen.refresh();
    for (const { feed } of this.#around) feed.held = undefined;
    this.#fared.refresh();
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
      base: timeBase,
      hide: [...hidden.peek()], panels: [...asked.peek()],
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
    if (this.#screen.held || this.problem.peek()) this.#read(now);
    this.#tell();
  }

  /** Milliseconds from the last request for the window to its samples in their rings. */
  get took(): number {
    return this.#screen.took;
  }

  dispose(): void {
    this.#screen.dispose();
    this.#fared.dispose();
    for (const { feed } of this.#around) feed.dispose();
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

  /** Where a channel's samples of the window are all there: what is drawn, when that is not summarised, or what is read. */
  #every({ info, ring }: Channel, from: number, to: number): Ring | undefined {
    const { held } = this.#screen;
    const whole = held?.exact && held.stretch.t0 <= Math.max(from, this.bounds.first) && held.stretch.t1 >= Math.min(to, this.bounds.last);
    const drawn = whole ? this.drawn.channel(info.device, info.name)?.ring : undefined;
    if (drawn && drawn.length > 0) return drawn;
    const around = this.#around.find(({ near }) => near.channels.includes(info.id))?.feed.held;
    return around?.exact && around.stretch.t0 <= Math.max(from, this.bounds.first) && around.stretch.t1 >= Math.min(to, this.bounds.last) ? ring : undefined;
  }

  /** Have the samples around what is read. */
  #read(now: number): void {
    const { device, timeBase: base } = view.peek();
    if (device !== this.#aroundOf) this.#choose(device);
    const { time } = readingAt(view.peek(), cursor.peek(), this.head);
    const ahead = this.playing.peek() ? 0.3 * this.speed.peek() : 0;
    for (const around of this.#around) {
      const { near, feed } = around;
      const { held } = feed;
      if (held && !held.exact && around.share * near.before > LEAST_REACH_S) {
        around.share /= 2;
        feed.held = undefined;
      }
      const reach = around.share * near.before;
      this.#forgetOld(around, time, now);
      const here = held && feed.holds(near.channels, base) && held.stretch.t0 <= Math.max(time - 0.3 * reach, this.bounds.first - 1);
      if (here && feed.held && held.stretch.t1 >= Math.min(time + Math.min(ahead, 0.3 * reach), this.bounds.last)) continue;
      // Where it will be read when the answer is here.
      const lead = this.playing.peek() ? this.speed.peek() * Math.min(LONGEST_LEAD_S, (feed.took || 0) / 1000) : 0;
      const middle = Math.min(time + lead, this.bounds.last);
      feed.ask({ stretch: { t0: middle - reach, t1: middle + reach, width: NEAR_WIDTH }, channels: near.channels, base });
    }
  }

  /** A value from elsewhere in the recording is not shown for longer than an answer may take. */
  #forgetOld(around: Around, time: number, now: number): void {
    const stretch = around.feed.held?.stretch;
    if (stretch === undefined || (time >= stretch.t0 && time <= stretch.t1)) {
      around.missing = NaN;
    } else if (!(now - around.missing < PATIENCE_MS)) {
      if (around.missing === around.missing) {
        this.near.forget(around.near.channels);
        around.feed.held = undefined;
      } else around.missing = now;
    }
  }

  #choose(device: string | undefined): void {
    this.#aroundOf = device;
    for (const { feed } of this.#around) feed.dispose();
    const own = this.detail.channels.filter((info) => info.device === device);
    const told = (problem: Problem | undefined): void => {
      if (problem) this.problem.value = problem;
    };
    this.#around = nearOf(own, this.detail.longest_s).map((near) => ({ near, feed: new Feed(this.detail.info.id, this.near, told), share: 1, missing: NaN }));
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
function appOf(store: ReplayStore, minute: Minute, everySample: NonNullable<App["everySample"]>): App {
  const device = computed(() => store.devices.value.find(({ id }) => id === view.value.device));
  const state = signal<PageState>("live");
  return { store, minute, device, state, held: () => false, everySample };
}
