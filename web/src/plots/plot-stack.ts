/**
 * The plots of the selected device, one under the other on one time axis, with lanes, axis and memory strip.
 *
 *     ┌ gutter ─┬ plot area ───────────────────────────┬ tail ┐
 *     │ legend  │ acceleration, rate, field, tilt, yaw │ x    │   each a Plot: a canvas and a legend
 *     ├─────────┴───────────────────────────── glass ──┴──────┤   hatch, cursor, measure: one layer over all of them
 *     │ more    further quantities, one click each            │
 *     │ lanes   loss, then the status bits                    │
 *     │ axis    UTC · cursor                                  │
 *     │ memory  everything held, the window as a box          │
 *     └───────────────────────────────────────────────────────┘
 *
 * `update` runs once a frame. It computes the time window, then each part draws its changes. Layout is read once after it changed and
 * never in between, so a frame causes no reflow.
 */
import { computed, effect } from "@preact/signals";
import { sampledSpan, type Channel } from "../data/channels";
import type { Store } from "../data/store";
import type { ViewState } from "../data/view-state";
import type { CustomPlot, PlotOrder, Reads, PlotSpec, Series } from "../data/view";
import { fromExtensions } from "../extension/extension";
import { withCustomPlots } from "../signals/custom-plots";
import type { Openers } from "../page/context";
import { clock } from "../ui/format/format";
import { el, type Panel, throttle } from "../ui/dom/dom";
import { drawAxis } from "./axis";
import { listen } from "./gestures";
import { drawGlass, isBare, type Pane } from "./overlay";
import { type SeriesMenu, shownSample, valueAt } from "./legend";
import { Lanes } from "./status-lanes";
import { LaneNames } from "./lane-names";
import { type MarkLine, markersOf } from "./markers";
import { HistoryStrip } from "./history-strip";
import { onLook, palette, type Palette, CanvasLayer } from "./canvas-style";
import { MoreQuantities } from "./more-quantities";
import { Plot } from "./plot";
import type { MarkLayer } from "./plot-additions";
import { addGrips, type DragOut } from "./plot-grips";
import { heightOf, inOrder, PLOTS_TILE, tileOf } from "../data/plot-order";
import { protocolAmong } from "../wire/capabilities";
import { plain, usualPlots, sameSeries } from "../signals/plot-selection";
import { timeWindow, type TimeWindow } from "./time-window";
import { nearestSample } from "../measure/nearest-sample";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/plots";
import "./plots.css";

export interface StackDeps {
  readonly store: Store;
  readonly viewState: ViewState;
  /** Source of values if the drawn ones are summarised; default: as drawn. */
  readonly reads?: Reads;
  /** Bounds of all data, if the store holds only a part; default: the store's. */
  readonly bounds?: () => { readonly first: number; readonly last: number };
  /** Markers to draw; default: those among the store's events. */
  readonly markers?: () => readonly MarkLine[];
  /** The tile whose plots these are; default: of those without a tile of their own, with lanes and memory strip under them. */
  readonly tile?: string;
  /** Follows a plot that is dragged out of its tile. */
  readonly dragOut?: DragOut;
  /** Opens the tree of all signals, and the frame of a sample. */
  readonly open?: Pick<Openers, "signals"> & Partial<Pick<Openers, "packet" | "dialog">>;
}

/** Legends follow live data this often, a moving cursor every frame. */
const LEGENDS_HZ = 12;

class Stack implements Panel {
  readonly #store: Store;
  readonly #state: ViewState;
  readonly #reads: Reads;
  readonly #whole: StackDeps["bounds"];
  readonly #markers: () => readonly MarkLine[];
  readonly #layers: readonly MarkLayer[];
  readonly #root = el("div", { class: "stack flex-column", tabindex: "0", role: "group", "aria-label": COMMON.plots });
  readonly #glass = new CanvasLayer(el("canvas", { class: "cursor-layer", "aria-hidden": "true" }));
  readonly #more: MoreQuantities;
  readonly #lanesBox = el("div", { class: "lane-box" });
  readonly #lanesHost = el("div", { class: "lanes" });
  readonly #lanesSheet = new CanvasLayer(el("canvas", { role: "img", "aria-label": TEXT.statusLanesLabel }));
  readonly #axis = new CanvasLayer(el("canvas", { role: "img", "aria-label": COMMON.timeAxis }));
  readonly #over = new CanvasLayer(el("canvas", { role: "img", "aria-label": TEXT.everythingInMemory }));
  readonly #names: LaneNames;
  readonly #lanes = new Lanes();
  readonly #strip = new HistoryStrip();
  readonly #stops: (() => void)[] = [];
  readonly #legendsDue = throttle(LEGENDS_HZ);
  readonly #slowlyDue = throttle(2);
  readonly #stillDue = throttle(10);
  readonly #stripDue = throttle(4);
  readonly #stamps = new Map<string, string>();
  readonly #seen: IntersectionObserver;
  readonly #tile: string;
  readonly #dragOut: DragOut | undefined;
  #plots: Plot[] = [];
  /** Those of all tiles. */
  #all: readonly PlotSpec[] = [];
  #specs: readonly PlotSpec[] = [];
  #channels: readonly Channel[] = [];
  #look: Palette;
  #theme = 0;
  #layoutDue = true;
  #window: TimeWindow | undefined;
  #selection: readonly [number, number] | undefined;
  /** The plot last pressed: cursors snap to its samples. */
  #aimed: Plot | undefined;
  /** Height of that press, px from its top. */
  #aimedY = NaN;
  #cursorWas = "";
  #panes: readonly Pane[] = [];
  /** Last seen revision of the samples; ten times a second suffices while the window stands still. */
  #still = 0;
  readonly #openPacket: Openers["packet"] | undefined;
  readonly #openDialog: Openers["dialog"] | undefined;

  constructor(host: HTMLElement, deps: StackDeps) {
    const { store, viewState, reads = (channel) => channel, bounds, markers, open, tile = PLOTS_TILE, dragOut } = deps;
    this.#tile = tile;
    this.#dragOut = dragOut;
    this.#markers = markers ?? markersOf(store, viewState);
    this.#layers = fromExtensions("plotMarks").map((marks) => marks(store, viewState));
    this.#openPacket = open?.packet;
    this.#openDialog = open?.dialog;
    this.#store = store;
    this.#state = viewState;
    this.#reads = reads;
    this.#whole = bounds;
    this.#names = new LaneNames(this.#lanesBox, () => this.#slowly());
    this.#lanesBox.append(this.#lanesSheet.canvas);
    this.#lanesHost.append(this.#lanesBox, this.#names.say);
    this.#more = new MoreQuantities(viewState, open && (() => open.signals()), {
      shown: (key) => this.#plots.find(({ spec }) => spec.key === key)?.root.scrollIntoView({ block: "nearest" }),
      resized: () => (this.#layoutDue = true),
    });
    const axis = el("div", { class: "axis" }, this.#axis.canvas);
    const over = el("div", { class: "history-strip" }, this.#over.canvas);
    if (!this.#isFirst) for (const part of [this.#more.root, this.#lanesHost, over]) part.hidden = true;
    this.#root.append(this.#more.root, this.#lanesHost, axis, over, this.#glass.canvas);
    host.append(this.#root);
    this.#look = palette(this.#root);
    this.#seen = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) {
        const plot = this.#plots.find(({ root }) => root === target);
        if (plot !== undefined) plot.visible = isIntersecting;
      }
    });
    this.#watch();
  }

  get #isFirst(): boolean {
    return this.#tile === PLOTS_TILE;
  }

  #watch(): void {
    const relook = (): void => {
      this.#theme += 1;
      this.#layoutDue = true;
    };
    const { device } = this.#state;
    const order = computed(() => this.#state.plotOrder.value.order);
    const tiles = computed(() => this.#state.plotOrder.value.tiles);
    this.#stops.push(
      onLook(this.#root, relook),
      listen(this.#root, this.#state, {
        window: () => this.#window,
        strip: () => this.#strip.window,
        selecting: (span) => (this.#selection = span),
        bytes: (t) => this.#bytes(t),
        aim: (y) => {
          this.#aimed = this.#plots.findLast(({ top }) => top <= y);
          this.#aimedY = y - (this.#aimed?.top ?? 0);
        },
      }),
      effect(() => {
        const { extraPlots, customPlots } = this.#state;
        void [order.value, tiles.value];
        this.#choose(this.#store.channels.value, device.value, extraPlots.value, customPlots.value);
      }),
      effect(() => this.#size(this.#state.plotOrder.value)),
      effect(() => {
        this.#lanesHost.hidden = !this.#isFirst || this.#state.layout.value.panels["lanes"]?.shown === true; // a panel has them
        this.#layoutDue = true;
      }),
      effect(() => {
        for (const plot of this.#plots) plot.legend.show(this.#state.hiddenSeries.value);
      }),
    );
    if (!this.#isFirst) return;
    this.#state.actions.attachPlots({
      now: () => this.#now(),
      bounds: () => this.#bounds(),
      step: (t, steps) => this.#step(t, steps),
      nearest: (t) => this.#nearest(t),
      bytes: (t) => this.#bytes(t),
      plots: () => this.#all,
      series: () => this.#all.flatMap(plain),
      beside: (key) => this.#all.filter(({ series }) => series.some((one) => one.key === key)).flatMap(plain),
    });
  }

  /** Set the plots for the device's channels; existing ones keep their scale. */
  #choose(
    channels: readonly Channel[],
    device: string | undefined,
    extra: ReadonlySet<string>,
    custom: readonly CustomPlot[],
  ): void {
    this.#channels = channels.filter(({ info }) => info.device === device);
    const protocol = protocolAmong(this.#store.devices.peek(), device);
    this.#specs = usualPlots(this.#channels, protocol?.plots);
    const chosen = this.#specs.filter(({ primary, key }) => primary !== extra.has(key));
    const of = this.#state.plotOrder.peek();
    this.#all = inOrder(withCustomPlots(chosen, custom, channels, device), of);
    const wanted = this.#all.filter(({ key }) => tileOf(of, key) === this.#tile);
    const before = this.#plots;
    this.#plots = wanted.map((spec) => before.find((plot) => sameSeries(plot.spec, spec)) ?? this.#plot(spec));
    for (const plot of before) {
      if (this.#plots.includes(plot)) continue;
      this.#seen.unobserve(plot.root);
      plot.root.remove();
    }
    for (const plot of this.#plots) {
      this.#more.root.before(plot.root);
      this.#seen.observe(plot.root);
    }
    this.#hideNorms();
    this.#size(this.#state.plotOrder.peek());
    if (this.#isFirst) this.#more.offer(this.#specs, extra);
    this.#lanes.keep(this.#channels);
    this.#strip.follow(this.#specs[0]);
    this.#theme += 1;
    this.#layoutDue = true;
  }

  #plot(spec: PlotSpec): Plot {
    const { customPlots, actions } = this.#state;
    const remove = (): void => {
      customPlots.value = customPlots.peek().filter(({ id }) => id !== spec.custom);
      this.#root.focus({ preventScroll: true }); // the button is gone
    };
    const toggle = (key: string, alone: boolean): void => actions.toggleKey(key, alone);
    const plot = new Plot(spec, toggle, this.#state, {
      remove: spec.custom === undefined ? undefined : remove,
      menu: (series) => this.#menu(series),
    });
    addGrips(plot, this.#state, () => this.#plots, this.#dragOut);
    return plot;
  }

  /** What the menu of a series opens; undefined: it has none. */
  #menu(series: Series): SeriesMenu | undefined {
    const [dialog, action] = [this.#openDialog, fromExtensions("seriesActions").find((one) => one.applies(series))];
    if (!dialog || !action) return undefined;
    const [store, viewState] = [this.#store, this.#state];
    return {
      title: action.title,
      open: () => action.run(series, { store, viewState, open: { dialog }, now: this.#now() }),
    };
  }

  /** Give each plot the height that was chosen. */
  #size(of: PlotOrder): void {
    for (const { root, spec } of this.#plots) {
      const height = heightOf(of, spec.key);
      root.style.flex = height === undefined ? "" : `0 0 ${height}px`;
      root.style.minHeight = height === undefined ? "" : `${height}px`;
    }
    this.#layoutDue = true;
  }

  #hideNorms(): void {
    const fresh = this.#plots
      .flatMap(({ spec }) => spec.series)
      .filter(({ norm, key }) => norm && !this.#state.knownNorms.has(key));
    for (const { key } of fresh) this.#state.knownNorms.add(key);
    if (fresh.length > 0)
      this.#state.hiddenSeries.value = new Set([...this.#state.hiddenSeries.peek(), ...fresh.map(({ key }) => key)]);
    for (const plot of this.#plots) plot.legend.show(this.#state.hiddenSeries.peek());
  }

  update(now: number): void {
    if (this.#slowlyDue(now)) {
      this.#slowly();
      this.#state.actions.keepFitted();
    }
    if (this.#layoutDue) this.#layout();
    const width = this.#axis.width - this.#look.gutter - this.#look.tail;
    if (width < 20) return;
    this.#state.actions.dropPassed();
    this.#state.actions.settle();
    const w = (this.#window = timeWindow(
      this.#state.view.peek(),
      this.#now(),
      this.#look.gutter,
      width,
      this.#axis.ratio,
    ));
    const shown = this.#state.hiddenSeries.peek();
    for (const plot of this.#plots) plot.draw(w, this.#look, shown, now, this.#theme);
    const reading = this.#state.actions.cursorTime();
    this.#read(now, w, reading);
    this.#drawShared(now, w, reading, shown);
  }

  /** Draw lanes, axis, memory strip and overlay, each if it changed: a window that stands still costs nothing. */
  #drawShared(now: number, w: TimeWindow, reading: number | undefined, shown: ReadonlySet<string>): void {
    const device = this.#state.view.peek().device ?? "";
    const losses = this.#store.losses(device);
    const frame = `${w.g1} ${w.dt} ${w.base} ${this.#theme} ${losses.length} ${losses.at(-1)?.t1}`;
    const still = this.#stillDue(now)
      ? this.#channels.reduce((sum, channel) => sum + this.#revisionOf(channel), 0)
      : this.#still;
    if (this.#changed("lanes", `${frame} ${still} ${this.#names.lanes.length}`) && this.#lanesSheet.height > 0) {
      this.#lanes.draw(this.#lanesSheet, this.#names.lanes, losses, w, this.#look);
    }
    this.#still = still;
    const cursors = `${reading} ${this.#state.measure.peek()}`;
    if (this.#changed("axis", `${frame} ${cursors}`))
      drawAxis(this.#axis, w, this.#look, reading, this.#state.measure.peek());
    if (
      this.#over.height > 0 &&
      (this.#stripDue(now) || this.#changed("memory", `${w.live} ${w.span} ${w.live || w.t1} ${this.#theme}`))
    ) {
      this.#strip.draw(this.#over, w, this.#look, this.#bounds()?.first, losses, this.#markers());
    }
    const lostSince = this.#lostSince(device);
    const markers = this.#markers();
    const marks = {
      losses,
      lostSince,
      markers,
      layers: this.#layers,
      cursor: reading,
      measure: this.#state.measure.peek(),
      selection: this.#selection,
      reads: this.#reads,
    };
    const bare = isBare(w, marks);
    // not even composed then: it is as large as all plots together
    if (this.#changed("bare", `${bare}`)) this.#glass.canvas.style.visibility = bare ? "hidden" : "";
    if (
      !bare &&
      this.#changed(
        "glass",
        `${frame} ${cursors} ${lostSince} ${this.#selection} ${markers.length} ${markers.at(-1)?.time} ${this.#layers.map((layer) => layer.stamp(this.#plots)).join()} ${shown.size} ${reading === undefined ? "" : still}`,
      )
    ) {
      drawGlass(this.#glass, this.#panes, this.#plots, w, this.#look, marks, shown);
    }
  }

  /** A number that changes with everything drawn of a channel, or read at a cursor. */
  #revisionOf(channel: Channel): number {
    const at = [this.#state.actions.cursorTime(), this.#state.measure.peek()].filter((t) => t !== undefined);
    return at.reduce((sum, t) => sum + this.#reads(channel, t).ring.revision, channel.ring.revision);
  }

  #changed(part: string, stamp: string): boolean {
    if (this.#stamps.get(part) === stamp) return false;
    this.#stamps.set(part, stamp);
    return true;
  }

  /** Update legends and the explanation of a lane. */
  #read(now: number, w: TimeWindow, reading: number | undefined): void {
    const state = `${reading !== undefined && !(w.live && this.#state.cursor.peek()?.kind === "pointer") ? reading : this.#state.cursor.peek()?.kind} ${this.#state.measure.peek()} ${w.base} ${this.#theme}`;
    if (state === this.#cursorWas && !this.#legendsDue(now)) return;
    this.#cursorWas = state;
    const t = reading ?? (w.live ? Infinity : w.t1);
    for (const plot of this.#plots)
      if (plot.visible) plot.legend.read(t, w.base, this.#state.measure.peek(), this.#look.narrow, this.#reads, w.now);
    this.#names.read(t, w.base, this.#store.losses(this.#state.view.peek().device ?? ""), this.#reads);
  }

  /** Twice a second: choose the lanes, update screen readers. */
  #slowly(): void {
    const absent = this.#store.devices.peek().find(({ id }) => id === this.#channels[0]?.info.device)?.absent;
    if (this.#names.choose(this.#channels, absent, this.#whole === undefined)) this.#layoutDue = true;
    const reading = this.#state.actions.cursorTime();
    const { span, live } = this.#state.view.peek();
    const where = live ? TEXT.lastSeconds(span) : TEXT.secondsUntil(span, clock(this.#state.view.peek().end));
    this.#axis.canvas.setAttribute(
      "aria-label",
      TEXT.timeAxisState(where, reading === undefined ? "" : TEXT.cursorAtUtc(clock(reading, 3))),
    );
  }

  #layout(): void {
    this.#layoutDue = false;
    this.#look = palette(this.#root);
    this.#root.classList.toggle("narrow", this.#look.narrow);
    const width = this.#root.clientWidth;
    for (const room of this.#plots.map((plot) => plot.makeRoom(this.#look))) if (room) this.#layoutDue = true;
    for (const plot of this.#plots) {
      plot.top = plot.root.offsetTop;
      plot.sheet.resize(width, plot.root.clientHeight);
      plot.measureTitle();
    }
    this.#ask();
    const box = (sheet: CanvasLayer): void => void sheet.resize(width, sheet.canvas.parentElement?.clientHeight ?? 0);
    [this.#lanesSheet, this.#axis, this.#over].forEach(box);
    const panes = this.#plots.map((plot) => ({
      top: plot.top + plot.inset(this.#look),
      bottom: plot.top + plot.sheet.height,
    }));
    // without lanes the overlay ends with the last plot
    const top = this.#lanesHost.hidden
      ? Math.max(0, ...panes.map((pane) => pane.bottom))
      : this.#lanesHost.offsetTop + this.#lanesBox.offsetTop;
    const bottom = top + this.#lanesSheet.height;
    this.#panes = [...panes, { top, bottom }];
    this.#glass.resize(width, bottom);
    this.#glass.canvas.style.height = `${bottom}px`;
    this.#theme += 1; // a resized canvas is blank
  }

  /** Ask for the room that the plots need beside lanes, axis and memory strip. */
  #ask(): void {
    if (!this.#isFirst) return;
    const under = [this.#more.root, this.#lanesHost, this.#axis.canvas.parentElement, this.#over.canvas.parentElement];
    const rest = under.reduce((sum, part) => sum + (part?.offsetHeight ?? 0), 0);
    const order = this.#state.plotOrder.peek();
    const sizes = this.#plots.map(({ spec, least }) => heightOf(order, spec.key) ?? least);
    const two = sizes.toSorted((a, b) => b - a).slice(0, 2);
    const least = rest + two.reduce((sum, px) => sum + px, 0);
    const height = rest + sizes.reduce((sum, px) => sum + px, 0);
    const { plotsWish } = this.#state;
    const next = { height, least, grows: true, keys: this.#all.map(({ key }) => key) };
    if (JSON.stringify(next) !== JSON.stringify(plotsWish.peek())) plotsWish.value = next;
  }

  /** Last arrival from the device, if it or the server is gone. A file that has ended is not gone, nor is a device that was never here. */
  #lostSince(device: string): number | undefined {
    const status = this.#store.devices.peek().find(({ id }) => id === device)?.status;
    if (status !== "lost" && status !== "denied" && status !== "connecting" && !this.#store.isCut) return undefined;
    if (status === "ended" || status === "idle") return undefined;
    const newest = Math.max(-Infinity, ...this.#channels.map(({ ring }) => ring.newest).filter((t) => t === t));
    return Number.isFinite(newest) ? newest : undefined;
  }

  #now(): number {
    return this.#store.edgeOf(this.#state.view.peek().device);
  }

  #bounds(): { readonly first: number; readonly last: number } | undefined {
    if (this.#whole) return this.#whole();
    return sampledSpan(this.#channels);
  }

  /** The sample `steps` on from t, of the first channel. */
  #step(t: number, steps: number): number | undefined {
    const channel = this.#all[0]?.series[0]?.channel;
    const ring = channel && this.#reads(channel, t).ring;
    const base = this.#state.view.peek().timeBase;
    if (ring === undefined || ring.length === 0) return undefined;
    // Half a microsecond: a cursor pinned to a sample must find that sample again.
    const i = ring.indexAt(t + 5e-7, base) + steps;
    if (i < 0 || i >= ring.length) return undefined;
    return base === "device" ? ring.time(i) : ring.arrival(i);
  }

  /** The sample nearest to t, of the plot last pressed; undefined while its neighbours are not loaded. */
  #nearest(t: number): number | undefined {
    const series = this.#aimedSeries();
    return series && nearestSample(this.#reads(series.channel, t).ring, t, this.#state.view.peek().timeBase);
  }

  /** Open the frame of the sample nearest to t. */
  #bytes(t: number): void {
    const { actions, view, hiddenSeries } = this.#state;
    const nearest = this.#aimed?.seriesAt(this.#aimedY, t, view.peek().timeBase, hiddenSeries.peek(), this.#reads);
    const series = nearest ?? this.#aimedSeries();
    if (series === undefined) return;
    const { info } = series.channel;
    const channel = info.id < 0 ? -1 - info.id : info.id; // of computed ones, that which they are computed from
    const [time, base] = [this.#nearest(t) ?? t, view.peek().timeBase];
    const sample = shownSample(series, valueAt(series, time, base, this.#reads), this.#store.sent(channel));
    this.#openPacket?.({ device: info.device, time, base, channel, sample, pin: (at) => actions.pinInView(at) });
  }

  /** The first visible series of the plot last pressed. */
  #aimedSeries(): Series | undefined {
    const plot = this.#aimed !== undefined && this.#plots.includes(this.#aimed) ? this.#aimed : this.#plots[0];
    const hidden = this.#state.hiddenSeries.peek();
    return plot?.spec.series.find(({ key }) => !hidden.has(key)) ?? plot?.spec.series[0];
  }

  dispose(): void {
    for (const stop of this.#stops) stop();
    const { cursor } = this.#state;
    if (cursor.peek()?.kind === "pointer") cursor.value = undefined; // the item under the pointer is gone
    this.#seen.disconnect();
    this.#root.remove();
  }
}

export const mountStack = (host: HTMLElement, deps: StackDeps): Panel => new Stack(host, deps);
