/**
 * What of a recording is on screen: which channels are drawn, and their samples of the window, as finely as the screen shows them.
 *
 *     want(window) ── held already? ──▶ nothing to do
 *                  └─ no ──▶ Feed ──▶ GET …/window, with room on both sides ──▶ store ──▶ plots
 *
 * Nothing of the page is touched: a recording that somebody is about to open has its samples here before it is shown (prefetch.ts).
 */
import { signal } from "@preact/signals";
import type { Channel } from "../data/channels";
import type { TimeBase } from "../data/view-state";
import { plotsOf } from "../plots/plot-selection";
import { asked } from "../plots/plot-stack";
import type { Problem } from "../ui/http";
import { Feed, type Held } from "./window-fetcher";
import { ReplayStore } from "./replay-store";
import { type Bounds, isEnough, stretchFor } from "./time-range";
import type { RecordingDetail } from "./types";

/** Plots are seldom wider than this before their width is known, px. */
const USUAL_PX = 1200;

export interface Shown {
  readonly device: string | undefined;
  readonly t0: number;
  readonly t1: number;
  readonly base: TimeBase;
  /** Seconds of the recording that pass in a second; 0: it stands still. */
  readonly speed: number;
}

export class Screen {
  /** Width of the plots, px; as it was last known, until it is. */
  static #pixels = USUAL_PX;
  readonly store: ReplayStore;
  readonly bounds: Bounds;
  /** What was wrong with the last answer. */
  readonly problem = signal<Problem | undefined>(undefined);
  readonly #feed: Feed;
  #chosen: { readonly from: readonly Channel[]; readonly device: string | undefined; readonly asked: ReadonlySet<string>; readonly ids: readonly number[] } | undefined;

  constructor(readonly detail: RecordingDetail) {
    this.bounds = boundsOf(detail);
    this.store = new ReplayStore(detail, () => this.bounds.last);
    this.#feed = new Feed(detail.info.id, this.store, (problem) => (this.problem.value = problem));
  }

  get pixels(): number {
    return Screen.#pixels;
  }

  set pixels(width: number) {
    Screen.#pixels = width;
  }

  get held(): Held | undefined {
    return this.#feed.held;
  }

  /** Milliseconds from the last request to its samples in their rings. */
  get took(): number {
    return this.#feed.took;
  }

  /** What a recording shows that is opened without a place. */
  whole(): Shown {
    return { device: this.detail.devices[0]?.id, t0: this.bounds.first, t1: this.bounds.last, base: "device", speed: 0 };
  }

  /** Are the samples of this window here, as finely as the screen can show them? */
  has({ device, t0, t1, base, speed }: Shown): boolean {
    const { held } = this.#feed;
    return held !== undefined && this.#feed.holds(this.#channels(device), base) && isEnough(held.stretch, held.exact, t0, t1, this.pixels, speed, this.bounds);
  }

  /** Have them here, unless they are. */
  want(shown: Shown): void {
    if (this.has(shown)) return;
    const { device, t0, t1, base, speed } = shown;
    const channels = this.#channels(device);
    if (!this.#feed.holds(channels, base)) this.store.keepOnly(channels);
    this.#feed.ask({ stretch: stretchFor(t0, t1, this.pixels, speed, this.bounds), channels, base });
  }

  /** There is more by now: what is held is asked for again. */
  refresh(): void {
    this.#feed.held = undefined;
  }

  dispose(): void {
    this.#feed.dispose();
  }

  /** Those of the plots on screen, the status words under them, and where it was. */
  #channels(device: string | undefined): readonly number[] {
    const [from, wanted] = [this.store.channels.peek(), asked.peek()];
    const known = this.#chosen;
    if (known && known.from === from && known.device === device && known.asked === wanted) return known.ids;
    const own = from.filter(({ info }) => info.device === device);
    const shown = plotsOf(own).filter(({ primary, key }) => primary !== wanted.has(key));
    const ids = shown.flatMap(({ series }) => series.map(({ channel }) => channel.info.id));
    const status = own.filter(({ info }) => info.kind === "status").map(({ info }) => info.id);
    const track = own.filter(({ info }) => info.columns.some(({ name }) => /^lat/i.test(name))).map(({ info }) => info.id);
    this.#chosen = { from, device, asked: wanted, ids: [...new Set([...ids, ...status, ...track].map((id) => (id < 0 ? -1 - id : id)))] };
    return this.#chosen.ids;
  }
}

/** Device times may begin years off, before a receiver knows the date: those samples are there, but no axis starts with them. */
const FAR_OFF_S = 86_400;

function boundsOf({ t0, t1, info }: RecordingDetail): Bounds {
  const first = info.started !== null && t0 < info.started - FAR_OFF_S ? info.started : t0;
  return { first, last: Math.max(t1, first + 1e-3) };
}
