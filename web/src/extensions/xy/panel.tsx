/**
 * The XY plot: one signal of a device over another, in the range of the plots or between both cursors.
 *
 *     rings of both signals ── PairSeries ──┐
 *                                           ├─▶ pairs ──▶ drawXy
 *     a range beyond memory ── ServerPairs ─┘
 */
import { render } from "preact";
import { extent, indexAt, NO_PAIRS, type PairedColumn, PairSeries, type Pairs } from "./pairs";
import { channelsOf } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { Scale } from "../../charts/scale";
import { type Found, unitOf } from "../../signals/custom-plots";
import { surface } from "../../ui/dom/canvas";
import { el, LiveText, type Panel, throttle } from "../../ui/dom/dom";
import { clock, decimalsOf, number } from "../../ui/format/format";
import { chosenPair, signalName, nameWithUnit, plottableOf } from "./choice";
import { rangeOf } from "../../charts/range";
import { drawXy, nearestPair, type PlacedSample, timeColour } from "./draw";
import { ServerPairs } from "./server-pairs";
import { XyTools } from "./tools";
import { TEXT } from "./texts";
import "./xy.css";

/**
 * Pictures a second while samples come or the view moves: without a graphics card one takes 60 ms of a core. The pointer is
 * followed every frame.
 */
const PER_SECOND = 5;
const COLOUR_COUNT = 6;

interface Shown {
  readonly x: Found;
  readonly y: Found;
  /** A change of it needs other scales and other pairs. */
  readonly key: string;
}

class XyPlot {
  readonly #deps: Deps;
  readonly #canvas = el("canvas", { tabindex: "0", role: "img" });
  readonly #tools = el("div");
  readonly #about = new LiveText();
  readonly #reading = new LiveText();
  readonly #key = el("span", { class: "xy-key", "aria-hidden": "true" });
  readonly #surface = surface(this.#canvas, () => (this.#isDue = true));
  readonly #server: ServerPairs | undefined;
  readonly #often = throttle(PER_SECOND);
  readonly #stop = new AbortController();
  /** What the pair was looked for in, and how often it was. */
  #from: readonly unknown[] = [];
  #choices = 0;
  #chosen: Omit<Shown, "key"> | undefined;
  #isDue = true;
  #stamp = "";
  #revision = -1;
  #shown: Shown | undefined;
  #scales = { x: new Scale(1), y: new Scale(1) };
  #series: { readonly key: string; readonly of: PairSeries } | undefined;
  #pairs: Pairs = NO_PAIRS;
  /** What the pairs in memory were taken of: the same again gives the same pairs. */
  #taken = "";
  #told = "";
  #place: PlacedSample | undefined;
  /** The pair under the pointer. */
  #aimed = -1;

  constructor(host: HTMLElement, deps: Deps) {
    this.#deps = deps;
    this.#server = deps.samples && new ServerPairs(deps.samples.source);
    const foot = el("p", { class: "xy-foot flex-wrap mid text-xs" }, this.#about.node, this.#key);
    const reading = el("p", { class: "xy-reading text-xs" }, this.#reading.node);
    host.append(this.#tools, el("div", { class: "xy-picture" }, this.#canvas, reading), foot);
    render(<XyTools deps={deps} />, this.#tools);
    this.#listen();
    this.#colourKey();
  }

  update(now: number): void {
    const { viewState } = this.#deps;
    const view = viewState.view.peek();
    const pair = this.#pair();
    if (pair === undefined) return this.#show(undefined);
    const [a, b] = [viewState.actions.cursorTime(), viewState.measure.peek()];
    const state = `${a} ${b} ${view.live || view.end} ${view.span} ${view.timeBase} ${this.#choices}`;
    const stamp = `${state} ${document.documentElement.dataset["theme"]}`;
    const isMoved = stamp !== this.#stamp;
    const revision = pair.x.channel.ring.revision + pair.y.channel.ring.revision;
    const mayChange = view.live || this.#server !== undefined || revision !== this.#revision;
    if (!this.#isDue && !((isMoved || mayChange) && this.#often(now))) return;
    this.#revision = revision;
    if (isMoved) this.#colourKey();
    const isWanted = this.#isDue || isMoved;
    [this.#stamp, this.#isDue] = [stamp, false];
    this.#show({ ...pair, key: keyOf(pair) });
    const [t0, t1] = rangeOf(viewState.xy.peek(), a, b, viewState.actions.rightEdge(), view.span);
    const before = this.#pairs;
    const isNewest = this.#load(pair, t0, t1, now);
    const isRescaled = this.#rescale(now);
    const told = `${isNewest} ${this.#server?.problem?.message}`;
    if (!isWanted && !isRescaled && this.#pairs === before && told === this.#told) return;
    this.#told = told;
    this.#draw(pair, t0, t1, isNewest);
  }

  /** The pair that is shown: looked for when something that it depends on is another object, not once a frame. */
  #pair(): Omit<Shown, "key"> | undefined {
    const { store, viewState } = this.#deps;
    const from = [store.channels.peek(), viewState.xy.peek(), viewState.view.peek().device, viewState.frame.peek()];
    if (from.some((one, k) => one !== this.#from[k])) {
      this.#chosen = chosenPair(plottableOf(channelsOf(this.#deps)), viewState.xy.peek());
      this.#from = from;
      this.#choices += 1;
    }
    return this.#chosen;
  }

  dispose(): void {
    this.#stop.abort();
    this.#server?.dispose();
    this.#surface.dispose();
    render(null, this.#tools);
    this.#canvas.closest(".xy")?.replaceChildren();
  }

  #show(shown: Shown | undefined): void {
    this.#canvas.hidden = shown === undefined;
    if (shown?.key === this.#shown?.key) return;
    this.#shown = shown;
    this.#aimed = -1;
    [this.#pairs, this.#taken] = [NO_PAIRS, ""];
    if (shown) this.#scales = { x: scaleOf(shown.x), y: scaleOf(shown.y) };
  }

  /** Take the pairs of a range from memory, or from the server. False: they are those of another one, or none yet. */
  #load({ x, y }: Omit<Shown, "key">, t0: number, t1: number, now: number): boolean {
    const { samples, viewState } = this.#deps;
    const base = viewState.view.peek().timeBase;
    const how = viewState.xy.peek().pairing ?? "interpolated";
    const ring = (of: Found) => (samples ? samples.ringOf(of.channel, t0, t1) : of.channel.ring);
    const [ringX, ringY] = [ring(x), ring(y)];
    if (ringX && ringY) {
      const key = `${keyOf({ x, y })} ${base} ${how}`;
      const known = this.#series;
      const isKnown = known?.key === key && known.of.isOf(ringX, ringY);
      const taken = `${ringX.revision} ${ringY.revision} ${t0} ${t1}`;
      if (isKnown && taken === this.#taken) return true;
      if (!isKnown) this.#series = { key, of: new PairSeries(columnOf(x, ringX), columnOf(y, ringY), how, base) };
      this.#taken = taken;
      this.#pairs = this.#series?.of.between(t0, t1) ?? NO_PAIRS;
      return true;
    }
    this.#taken = "";
    const found = this.#server?.of({ x, y, how, range: { t0, t1, base } }, now);
    this.#pairs = found?.pairs ?? NO_PAIRS;
    return found?.isNewest ?? false;
  }

  /** Whether the values need other axes, or have not needed so long ones for a while. */
  #rescale(now: number): boolean {
    const isOther = this.#scales.x.update(...extent(this.#pairs.x), now, false);
    return this.#scales.y.update(...extent(this.#pairs.y), now, false) || isOther;
  }

  #draw({ x, y }: Omit<Shown, "key">, t0: number, t1: number, isNewest: boolean): void {
    const { viewState } = this.#deps;
    const { colour, draw, isEqual } = viewState.xy.peek();
    const pairs = this.#pairs;
    const names = { x: nameWithUnit(x), y: nameWithUnit(y) };
    const [a, b] = [viewState.actions.cursorTime(), viewState.measure.peek()];
    const marks = [
      ...(a === undefined ? [] : [{ letter: b === undefined ? "" : "A", ...this.#at(x, y, a) }]),
      ...(b === undefined ? [] : [{ letter: "B", ...this.#at(x, y, b) }]),
    ];
    this.#place = drawXy(this.#surface, {
      pairs,
      ...{ t0, t1, names, marks },
      scales: this.#scales,
      isTrail: colour === "trail",
      isPoints: draw === "points",
      isEqual: isEqual === true && unitOf(x) === unitOf(y),
      isOld: !isNewest,
    });
    this.#key.hidden = colour === "trail";
    this.#tell(x, y, isNewest, marks);
  }

  #tell(
    x: Found,
    y: Found,
    isNewest: boolean,
    marks: readonly { readonly letter: string; readonly x: number; readonly y: number }[],
  ): void {
    const pairs = this.#pairs;
    const problem = this.#server?.problem?.message;
    const parts = [TEXT.samples(pairs.n)];
    if (pairs.time.length < pairs.n) parts.push(TEXT.thinned(number(pairs.time.length, 0)));
    const isNearest = this.#deps.viewState.xy.peek().pairing === "nearest";
    const [leader, follower] = pairs.leader === "y" ? [y, x] : [x, y];
    parts.push(
      pairs.leader === undefined ? TEXT.sameTimes : TEXT.atTimesOf(signalName(leader), signalName(follower), isNearest),
    );
    const isEmpty = pairs.n === 0;
    this.#about.set(
      isEmpty && problem !== undefined ? problem : isEmpty ? (isNewest ? TEXT.none : TEXT.loading) : parts.join(" · "),
    );
    const label = TEXT.canvas(signalName(y), signalName(x), TEXT.samples(pairs.n));
    if (this.#canvas.getAttribute("aria-label") !== label) this.#canvas.setAttribute("aria-label", label);
    const values = (u: number, v: number): string => `x ${inUnit(u, x)}  y ${inUnit(v, y)}`;
    const k = this.#aimed;
    const [time, u, v] = [pairs.time[k], pairs.x[k], pairs.y[k]];
    if (time !== undefined && u !== undefined && v !== undefined)
      this.#reading.set(`${clock(time, 3)}  ${values(u, v)}`);
    else this.#reading.set(marks.map((mark) => `${mark.letter} ${values(mark.x, mark.y)}`.trim()).join("   "));
  }

  /** The values that a cursor reads. */
  #at(x: Found, y: Found, t: number): { readonly x: number; readonly y: number } {
    const { samples, viewState } = this.#deps;
    const base = viewState.view.peek().timeBase;
    const how = viewState.xy.peek().pairing ?? "interpolated";
    const ring = (of: Found) => (samples ? samples.reads(of.channel, t) : of.channel).ring;
    const one = new PairSeries(columnOf(x, ring(x)), columnOf(y, ring(y)), how, base);
    return one.at(t) ?? { x: NaN, y: NaN };
  }

  #listen(): void {
    const canvas = this.#canvas;
    const { actions } = this.#deps.viewState;
    const { signal } = this.#stop;
    const aim = (event: PointerEvent | MouseEvent): number => {
      const box = canvas.getBoundingClientRect();
      return this.#place
        ? nearestPair(this.#pairs, this.#place, event.clientX - box.left, event.clientY - box.top)
        : -1;
    };
    const take = (k: number): void => {
      const time = this.#pairs.time[k];
      if (time !== undefined) actions.pin(time);
      [this.#aimed, this.#isDue] = [-1, true];
    };
    canvas.addEventListener(
      "pointermove",
      (event) => {
        this.#aimed = event.pointerType === "touch" ? -1 : aim(event);
        this.#isDue = true;
      },
      { signal },
    );
    canvas.addEventListener("pointerleave", () => ([this.#aimed, this.#isDue] = [-1, true]), { signal });
    canvas.addEventListener("click", (event) => take(aim(event)), { signal });
    canvas.addEventListener(
      "keydown",
      (event) => {
        const steps = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
        if (steps === 0 || event.ctrlKey || event.altKey || event.metaKey) return;
        event.preventDefault();
        event.stopPropagation();
        const { time } = this.#pairs;
        const from = indexAt(time, actions.cursorTime() ?? Infinity);
        take(Math.min(time.length - 1, Math.max(0, from + steps * (event.shiftKey ? 10 : 1))));
      },
      { signal },
    );
  }

  #colourKey(): void {
    const stops = Array.from({ length: COLOUR_COUNT }, (_, k) => timeColour(k / (COLOUR_COUNT - 1)));
    const bar = el("i");
    bar.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    this.#key.replaceChildren(TEXT.earlier, bar, TEXT.later);
  }
}

const keyOf = ({ x, y }: Omit<Shown, "key">): string =>
  [x, y].map(({ channel, column }) => `${channel.info.id} ${channel.info.frame} ${column}`).join("\n");

const columnOf = ({ channel, column }: Found, ring: PairedColumn["ring"]): PairedColumn => ({
  ring,
  column,
  period: channel.info.columns[column]?.period ?? 0,
});

function scaleOf({ channel, column }: Found): Scale {
  const info = channel.info.columns[column];
  return new Scale(20 * 10 ** -(info ? decimalsOf(info) : 3));
}

function inUnit(value: number, found: Found): string {
  const info = found.channel.info.columns[found.column];
  return `${number(value, info ? decimalsOf(info) : 3)} ${unitOf(found)}`.trimEnd();
}

export const mountXy = (host: HTMLElement, deps: Deps): Panel => new XyPlot(host, deps);
