/**
 * The lanes of a device as a panel: all of them, wherever a person puts them, on the time axis of the plots. While it is shown the plots
 * have no lanes. The same gestures as on the plots move through time and set the cursors.
 */
import { effect } from "@preact/signals";
import type { Channel } from "../data/channels";
import type { Deps } from "../page/context";
import { el, type Panel, throttle } from "../ui/dom/dom";
import { drawAxis } from "./axis";
import { onLook, CanvasLayer, palette, type Palette } from "./canvas-style";
import { listen } from "./gestures";
import { LaneNames } from "./lane-names";
import { Lanes } from "./status-lanes";
import { timeWindow, type TimeWindow, xOf } from "./time-window";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/plots";
import "./plots.css";

class LanesPanel {
  readonly #deps: Deps;
  readonly #root = el("div", { class: "stack flex-column lanes-stack" });
  readonly #box = el("div", { class: "lane-box" });
  readonly #sheet = new CanvasLayer(el("canvas", { role: "img", "aria-label": TEXT.statusLanesLabel }));
  readonly #axis = new CanvasLayer(el("canvas", { role: "img", "aria-label": COMMON.timeAxis }));
  readonly #glass = new CanvasLayer(el("canvas", { class: "cursor-layer", "aria-hidden": "true" }));
  readonly #names = new LaneNames(this.#box, () => this.#choose(), true);
  readonly #lanes = new Lanes();
  readonly #slowlyDue = throttle(2);
  readonly #readDue = throttle(12);
  readonly #stillDue = throttle(10);
  readonly #stops: (() => void)[] = [];
  #channels: readonly Channel[] = [];
  #look: Palette;
  #window: TimeWindow | undefined;
  #layoutDue = true;
  #theme = 0;
  #drawn = "";
  #cursors = "";
  #still = 0;

  constructor(host: HTMLElement, deps: Deps) {
    this.#deps = deps;
    this.#box.append(this.#sheet.canvas);
    const axis = el("div", { class: "axis" }, this.#axis.canvas);
    this.#root.append(el("div", { class: "lanes" }, this.#box, this.#names.say), axis, this.#glass.canvas);
    host.append(this.#root);
    this.#look = palette(this.#root);
    const relook = (): void => {
      this.#theme += 1;
      this.#layoutDue = true;
    };
    const { viewState } = deps;
    const { device } = viewState;
    this.#stops.push(
      onLook(this.#root, relook),
      effect(() => {
        const all = this.#store.channels.value;
        const next = all.filter(({ info }) => info.device === device.value);
        if (next.length === this.#channels.length && next.every((one, k) => one === this.#channels[k])) return;
        this.#channels = next;
        this.#lanes.keep(next);
        this.#choose();
      }),
      listen(this.#root, viewState, {
        window: () => this.#window,
        strip: () => undefined,
        selecting: () => undefined,
        aim: () => undefined,
        bytes: (t) => this.#bytes(t),
      }),
    );
  }

  /** Of a recording what is on screen, at its resolution. */
  get #store() {
    return this.#deps.samples?.drawn ?? this.#deps.store;
  }

  #choose(): void {
    const { device } = this.#deps.viewState.view.peek();
    const absent = this.#store.devices.peek().find(({ id }) => id === device)?.absent;
    if (this.#names.choose(this.#channels, absent)) this.#layoutDue = true;
  }

  #bytes(time: number): void {
    const { open, viewState } = this.#deps;
    const { device, timeBase } = viewState.view.peek();
    if (device === undefined) return;
    open.packet({ device, time, base: timeBase, pin: (at) => viewState.actions.pinInView(at) });
  }

  update(now: number): void {
    if (this.#slowlyDue(now)) this.#choose();
    if (this.#layoutDue) this.#layout();
    const { viewState } = this.#deps;
    const width = this.#axis.width - this.#look.gutter - this.#look.tail;
    if (width < 20) return;
    const view = viewState.view.peek();
    const device = view.device ?? "";
    const w = timeWindow(view, this.#store.edgeOf(view.device), this.#look.gutter, width, this.#axis.ratio);
    this.#window = w;
    const losses = this.#store.losses(device);
    if (this.#stillDue(now)) this.#still = this.#channels.reduce((sum, { ring }) => sum + ring.revision, 0);
    const frame = `${w.g1} ${w.dt} ${w.base} ${this.#theme} ${losses.length} ${losses.at(-1)?.t1} ${this.#still}`;
    const [reading, measure] = [viewState.actions.cursorTime(), viewState.measure.peek()];
    const isMoved = frame !== this.#drawn;
    if (isMoved) this.#lanes.draw(this.#sheet, this.#names.lanes, losses, w, this.#look);
    const cursors = `${reading} ${measure}`;
    if (isMoved || cursors !== this.#cursors) {
      drawAxis(this.#axis, w, this.#look, reading, measure);
      this.#drawCursors(w, [reading, measure]);
    }
    [this.#drawn, this.#cursors] = [frame, cursors];
    const reads = this.#deps.samples?.reads ?? ((channel: Channel) => channel);
    if (this.#readDue(now)) this.#names.read(reading ?? (w.live ? Infinity : w.t1), w.base, losses, reads);
  }

  #drawCursors(w: TimeWindow, times: readonly (number | undefined)[]): void {
    const x = this.#glass.begin();
    x.fillStyle = this.#look.colour["ink-2"];
    for (const t of times)
      if (t !== undefined && t >= w.t0 && t <= w.t1)
        x.fillRect(this.#glass.snap(xOf(w, t)), 0, 1 / this.#glass.ratio, this.#glass.height);
  }

  #layout(): void {
    this.#layoutDue = false;
    this.#look = palette(this.#root);
    this.#root.classList.toggle("narrow", this.#look.narrow);
    const width = this.#root.clientWidth;
    for (const sheet of [this.#sheet, this.#axis]) sheet.resize(width, sheet.canvas.parentElement?.clientHeight ?? 0);
    const bottom = this.#box.offsetTop + this.#sheet.height;
    this.#glass.resize(width, bottom);
    this.#glass.canvas.style.height = `${bottom}px`;
    this.#theme += 1; // a resized canvas is blank
  }

  dispose(): void {
    for (const stop of this.#stops) stop();
    this.#root.remove();
  }
}

export const mountLanes = (host: HTMLElement, deps: Deps): Panel => new LanesPanel(host, deps);
