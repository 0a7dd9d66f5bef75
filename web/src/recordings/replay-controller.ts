/**
 * An open recording: reading position, range on screen, and the samples for both.
 *
 *     head, speed, loop ──▶ view, cursor (of its own view state) ──▶ plots, panels
 *                             │
 *                             ├─ the window, at screen resolution ──▶ VisibleRange ──▶ store `drawn`   for plots
 *                             ├─ unsummarised samples around the cursor ──▶ Vicinity ──▶ store `near`   for reading
 *                             └─ samples around the measuring cursor ──▶ Vicinity ──▶ store `far`        for measuring
 *
 * `near` has the devices' state at the head: its clock is the head, its events are those that had happened by then.
 */
import { computed, effect, type ReadonlySignal, signal } from "@preact/signals";
import type { Ring } from "../data/ring-buffer";
import type { Stats } from "../data/statistics";
import type { Channel } from "../data/channels";
import type { ViewState } from "../data/view-state";
import { RecentHealth } from "../data/health-history";
import { type CursorReading, readingAt } from "../data/cursor-time";
import type { SampleAccess } from "../measure/sample-access";
import type { Deps } from "../page/context";
import type { HttpProblem } from "../requests/http";
import { type LinkedPlace, seriesOf, takeSeries } from "../page/permalink";
import { HealthHistoryFeed, minuteAt } from "./health-history";
import { healthAt, lostAfter, until } from "./health-at";
import { advance, begin, followed, type Playing } from "./playback";
import { ReplayStore } from "./replay-store";
import { VisibleRange, type ShownChannels } from "./visible-range";
import { changedStats, StatisticsFeed } from "./statistics-feed";
import type { DeviceInfo } from "../wire/types";
import type { Bounds } from "./time-range";
import type { MarkerInfo, RecordingDetail } from "../wire/recording-types";
import { isShared } from "../signals/names";
import { Vicinity } from "./vicinity";

/** Kinds with mean and spread (panels/value-groups.ts). */
const COUNTED: ReadonlySet<string> = new Set(["vector", "euler", "quaternion", "matrix", "scalar"]);
/** Updates of figures per second, as live. */
const TOLD_PER_S = 2;

export class ReplayController {
  readonly drawn: ReplayStore;
  readonly near: ReplayStore;
  readonly far: ReplayStore;
  /** Context of the panels, but for what the page adds: always with something on screen, and never stale. */
  readonly deps: Omit<Deps, "open" | "eventSort">;
  /** Samples of any range. */
  readonly samples: SampleAccess;
  readonly device: ReadonlySignal<DeviceInfo | undefined>;
  readonly bounds: Bounds;
  readonly markers = signal<readonly MarkerInfo[]>([]);
  readonly playing = signal(false);
  readonly speed = signal(1);
  readonly loop = signal<readonly [number, number] | undefined>(undefined);
  readonly looping = signal(false);
  readonly follow = signal(true);
  /** Why samples are missing, on screen or around the cursors. */
  readonly problem = signal<HttpProblem | undefined>(undefined);
  /** Decoded fraction, 0..1. */
  readonly progress = signal(1);
  /** Reading position, unix s. Changes with every frame: not a signal. */
  head: number;
  readonly #screen: VisibleRange;
  readonly #history: HealthHistoryFeed;
  readonly #recentHealth = new RecentHealth();
  readonly #statistics: StatisticsFeed;
  readonly #read: Vicinity;
  readonly #measured: Vicinity;
  #frame = NaN;
  readonly #unframe: () => void;
  #lastState = "";

  /** @param screen of this recording, if prefetched */
  constructor(
    readonly detail: RecordingDetail,
    place: LinkedPlace,
    readonly viewState: ViewState,
    screen = new VisibleRange(detail),
  ) {
    this.#screen = screen;
    this.bounds = screen.bounds;
    this.head = this.bounds.first;
    this.drawn = screen.store;
    this.near = new ReplayStore(detail, () => this.head);
    this.far = new ReplayStore(detail, () => this.head);
    this.#history = new HealthHistoryFeed(detail.info.id, this.bounds);
    this.#statistics = new StatisticsFeed(detail.info.id);
    this.#read = new Vicinity(detail, this.near, this.bounds);
    this.#measured = new Vicinity(detail, this.far, this.bounds);
    this.#unframe = effect(() =>
      [this.drawn, this.near, this.far].forEach((store) => store.showIn(this.viewState.frame.value)),
    );
    this.markers.value = detail.markers;
    this.progress.value = detail.progress;
    this.device = computed(() => this.near.devices.value.find(({ id }) => id === viewState.device.value));
    this.samples = {
      drawn: this.drawn,
      reads: (channel, t) => this.reads(channel, t),
      ringOf: (channel, from, to) => this.ringOf(channel, from, to),
      source: {
        id: detail.info.id,
        prefix: (info) =>
          (detail.devices.length > 1 ? `${info.device}/` : "") +
          (isShared(info, detail.channels) ? `${info.message}/` : ""),
        sent: (id) => this.near.sent(id),
        changeOf: (id) => this.near.changeOf(id),
      },
    };
    this.deps = {
      store: this.near,
      samples: this.samples,
      recentHealth: this.#recentHealth,
      viewState,
      held: () => false,
      allEvents: detail.events,
      jump: ({ t0 }) => this.seek(t0),
      statistics: (channel, column, at) => this.#statisticsOf(channel, column, at),
      lostLater: (of) => lostAfter(detail.events, of, this.head),
    };
    this.go(place);
    this.#screen.want(this.#shown); // at once, before anything is drawn
    this.#tell();
  }

  /** Width of the plots, px. */
  set pixels(width: number) {
    this.#screen.pixels = width;
  }

  /** Whether the samples on screen are loaded at screen resolution. */
  get isShown(): boolean {
    return this.#screen.has(this.#shown);
  }

  get #shown(): ShownChannels {
    const { end, span, device, timeBase: base } = this.viewState.view.peek();
    return {
      device,
      t0: end - span,
      t1: end,
      base,
      speed: this.playing.peek() && this.follow.peek() ? this.speed.peek() : 0,
      extraPlots: this.viewState.extraPlots.peek(),
      customPlots: this.viewState.customPlots.peek(),
    };
  }

  /** Show a place; by default the whole recording and its first device. */
  go(place: LinkedPlace): void {
    const { first, last } = this.bounds;
    const known = this.detail.devices.some(({ id }) => id === place.device);
    const device = known ? place.device : this.detail.devices[0]?.id;
    const [t0, t1] = [place.t0 ?? first, place.t1 ?? last];
    if (place.speed) this.speed.value = place.speed;
    if (place.loop) [this.loop.value, this.looping.value] = [place.loop, true];
    if (place.hide.length + place.show.length > 0)
      this.viewState.hiddenSeries.value = takeSeries(place, this.viewState.knownNorms);
    if (place.panels.length > 0) this.viewState.extraPlots.value = new Set(place.panels);
    if (place.plots) this.viewState.customPlots.value = place.plots;
    if (place.frame) this.viewState.frame.value = place.frame;
    this.viewState.measure.value = place.measure;
    this.viewState.view.value = {
      device,
      live: false,
      end: t1,
      span: Math.max(t1 - t0, 0.005),
      timeBase: place.base ?? "device",
    };
    // the file may begin before the device was measuring: its first sample is read, not nothing
    const begin = Math.min(Math.max(t0, this.detail.begins[device ?? ""] ?? t0), t1);
    this.#put(Math.min(Math.max(place.cursor ?? begin, first), last));
  }

  /** More of it is decoded. False if more than samples changed (a channel, a device, the end): then it must be reopened. */
  grow({ devices, channels, t0, t1, progress }: RecordingDetail): boolean {
    const now = this.detail;
    if (
      progress === 1 ||
      devices.length !== now.devices.length ||
      channels.length !== now.channels.length ||
      t0 !== now.t0 ||
      t1 !== now.t1
    )
      return false;
    this.progress.value = progress;
    this.#screen.refresh();
    for (const one of [this.#read, this.#measured, this.#history, this.#statistics]) one.refresh();
    return true;
  }

  /** Reopened at the same place, continuing playback. */
  reopened(detail: RecordingDetail): ReplayController {
    const { t0, t1, ...rest } = this.place();
    const whole = t0 !== undefined && t1 !== undefined && t0 <= this.bounds.first && t1 >= this.bounds.last;
    const [playing, speed, follow] = [this.playing.peek(), this.speed.peek(), this.follow.peek()];
    this.dispose();
    const next = new ReplayController(
      detail,
      whole ? rest : { ...rest, ...(t0 !== undefined ? { t0 } : {}), ...(t1 !== undefined ? { t1 } : {}) },
      this.viewState,
    );
    [next.playing.value, next.speed.value, next.follow.value] = [playing, speed, follow];
    return next;
  }

  /** Content of a link to the view. */
  place(): LinkedPlace {
    const { end, span, device, timeBase } = this.viewState.view.peek();
    const loop = this.loop.peek();
    return {
      t0: end - span,
      t1: end,
      cursor: this.head,
      ...(loop && this.looping.peek() ? { loop } : {}),
      ...(this.speed.peek() === 1 ? {} : { speed: this.speed.peek() }),
      ...(device !== undefined ? { device } : {}),
      ...(this.viewState.measure.peek() === undefined ? {} : { measure: this.viewState.measure.peek()! }),
      ...(this.viewState.frame.peek() === undefined ? {} : { frame: this.viewState.frame.peek()! }),
      base: timeBase,
      ...seriesOf(this.viewState.hiddenSeries.peek(), this.viewState.knownNorms),
      panels: [...this.viewState.extraPlots.peek()],
      ...(this.viewState.customPlots.peek().length > 0 ? { plots: this.viewState.customPlots.peek() } : {}),
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

  /** Move the reading position; the window follows if it is off screen. */
  seek(t: number): void {
    const { first, last } = this.bounds;
    const to = Math.min(last, Math.max(first, t));
    const { end, span } = this.viewState.view.peek();
    if (to < end - span || to > end)
      this.viewState.view.value = { ...this.viewState.view.peek(), end: followed(end, span, this.head, to) };
    this.#put(to);
  }

  /** Loop the range on screen, or stop looping. */
  toggleLoop(): void {
    if (this.looping.peek()) {
      this.looping.value = false;
      return;
    }
    const { end, span } = this.viewState.view.peek();
    this.loop.value = [Math.max(end - span, this.bounds.first), Math.min(end, this.bounds.last)];
    this.looping.value = true;
  }

  choose(device: string): void {
    this.viewState.view.value = { ...this.viewState.view.peek(), device };
  }

  /** Called once a frame; `now` in ms. */
  tick(now: number): void {
    const seconds = Math.min(0.25, (now - this.#frame) / 1000); // a tab that slept continues at its position
    this.#frame = now;
    const at = this.viewState.cursor.peek();
    if (at?.kind === "pinned" && at.time !== this.head) this.head = at.time; // the user pressed on a plot or stepped
    if (this.playing.peek()) this.#advance(seconds);
    this.#screen.want(this.#shown);
    // drawing comes first, reading a moment later
    if (this.#screen.held || this.problem.peek()) this.#around(now);
    const measured = this.viewState.measure.peek() === undefined ? undefined : this.#measured.problem;
    this.problem.value = this.#screen.problem ?? this.#read.problem ?? measured;
    this.#tell();
  }

  dispose(): void {
    this.#unframe();
    this.#screen.dispose();
    for (const one of [this.#read, this.#measured, this.#history, this.#statistics]) one.dispose();
  }

  #state(): Playing {
    return {
      head: this.head,
      playing: this.playing.peek(),
      speed: this.speed.peek(),
      loop: this.loop.peek(),
      looping: this.looping.peek(),
    };
  }

  #put(t: number): void {
    this.head = t;
    this.viewState.cursor.value = { kind: "pinned", time: t };
  }

  #advance(seconds: number): void {
    const was = this.head;
    const next = advance(this.#state(), seconds, this.bounds);
    this.#put(next.head);
    if (next.playing !== this.playing.peek()) this.playing.value = next.playing;
    const { end, span } = this.viewState.view.peek();
    const whole = span >= this.bounds.last - this.bounds.first;
    if (this.follow.peek() && !whole)
      this.viewState.view.value = { ...this.viewState.view.peek(), end: followed(end, span, was, next.head) };
  }

  /** The store with a channel's unsummarised samples at `t`: around the cursor, or around the measuring one. */
  reads(channel: Channel, t: number): Channel {
    const store = t === this.viewState.measure.peek() ? this.far : this.near;
    return store.channel(channel.info.device, channel.info.name) ?? channel;
  }

  /** The ring with all of a channel's samples of a range, if the page holds them. */
  ringOf(channel: Channel, from: number, to: number): Ring | undefined {
    return this.#every(this.reads(channel, this.head), from, to);
  }

  /** Statistics of the window: from its samples if all are loaded, else from the server. */
  #statisticsOf(channel: Channel, column: number, { from, to }: CursorReading): Stats | undefined {
    const base = this.viewState.view.peek().timeBase;
    const ring = this.#every(channel, from, to);
    if (ring) return ring.stats(column, from, to, base);
    const { device } = channel.info;
    const channels = this.detail.channels
      .filter((info) => info.device === device && COUNTED.has(info.kind))
      .map(({ id }) => id);
    this.#statistics.want({
      channels,
      from: Math.max(from, this.bounds.first),
      to: Math.min(to, this.bounds.last),
      base,
    });
    return changedStats(
      this.near.changeOf(channel.info.id)?.[column],
      column,
      channel.info.columns[column]?.period ?? 0,
      (k) => this.#statistics.of(channel.info.id, k),
    );
  }

  /** The ring with all of a channel's samples of the window: the drawn one if unsummarised, or the one for reading. */
  #every({ info, ring }: Channel, from: number, to: number): Ring | undefined {
    const { held } = this.#screen;
    const whole =
      held?.exact &&
      held.stretch.t0 <= Math.max(from, this.bounds.first) &&
      held.stretch.t1 >= Math.min(to, this.bounds.last);
    const drawn = whole ? this.drawn.channel(info.device, info.name)?.ring : undefined;
    if (drawn && drawn.length > 0) return drawn;
    return this.#read.isWhole(info.id, from, to) ? ring : undefined;
  }

  /** Load the samples around the reading position, and around the measuring cursor. */
  #around(now: number): void {
    const { device, timeBase: base } = this.viewState.view.peek();
    const { time } = readingAt(this.viewState.view.peek(), this.viewState.cursor.peek(), this.head);
    const other = this.viewState.measure.peek();
    const others = this.viewState.customPlots.peek().flatMap(({ signals }) => signals.map((signal) => signal.device));
    const devices = [...new Set([...(device === undefined ? [] : [device]), ...others])];
    this.#read.around({ devices, time, base, speed: this.playing.peek() ? this.speed.peek() : 0 }, now);
    if (other !== undefined) this.#measured.around({ devices, time: other, base, speed: 0 }, now);
  }

  /** Set events and figures as of the head. */
  #tell(): void {
    const { device } = this.viewState.view.peek();
    const happened = until(this.detail.events, this.head);
    const history = device === undefined ? undefined : this.#history.at(device, this.head);
    const state = `${happened.length} ${device} ${this.#history.version} ${Math.floor(this.head * TOLD_PER_S)}`;
    if (state === this.#lastState) return;
    this.#lastState = state;
    if (happened.length !== this.near.events.peek().length) this.near.events.value = happened;
    if (device === undefined) return;
    this.near.health.value = new Map([[device, healthAt(this.detail, device, this.head, history)]]);
    if (history) this.#recentHealth.put(device, minuteAt(history, happened, device, this.head));
  }
}
