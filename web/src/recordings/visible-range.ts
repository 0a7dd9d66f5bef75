/**
 * The range of a recording on screen: the drawn channels and their samples of the window, at screen resolution.
 *
 *     want(window) ── held already? ──▶ nothing to do
 *                  └─ no ──▶ WindowFetcher ──▶ GET …/window, with a margin on both sides ──▶ store ──▶ plots
 *
 * Nothing of the page is used: a recording about to be opened has its samples here before it is shown (prefetch.ts).
 */
import type { Channel } from "../data/channels";
import type { CustomPlot, TimeBase } from "../data/view";
import { protocolAmong } from "../wire/capabilities";
import { usualPlots } from "../signals/plot-selection";
import { withCustomPlots } from "../signals/custom-plots";
import { WindowFetcher, type HeldWindow } from "./window-fetcher";
import { ReplayStore } from "./replay-store";
import { type Bounds, isEnough, stretchFor } from "./time-range";
import type { RecordingDetail } from "../wire/recording-types";

/** Usual width of plots before it is known, px. */
const USUAL_PX = 1200;

export interface ShownChannels {
  readonly device: string | undefined;
  readonly t0: number;
  readonly t1: number;
  readonly base: TimeBase;
  /** Further plots, by key (view-state.ts). */
  readonly extraPlots: ReadonlySet<string>;
  /** Plots put together by the user. */
  readonly customPlots: readonly CustomPlot[];
  /** Recorded seconds per second; 0: it stands still. */
  readonly speed: number;
}

export class VisibleRange {
  /** Width of the plots of another range, px: the likely width of these. */
  static #lastPixels = USUAL_PX;
  #pixels = VisibleRange.#lastPixels;
  readonly store: ReplayStore;
  readonly bounds: Bounds;
  readonly #fetcher: WindowFetcher;
  #chosen:
    | {
        readonly from: readonly Channel[];
        readonly device: string | undefined;
        readonly extraPlots: ReadonlySet<string>;
        readonly customPlots: readonly CustomPlot[];
        readonly ids: readonly number[];
      }
    | undefined;

  constructor(readonly detail: RecordingDetail) {
    this.bounds = boundsOf(detail);
    this.store = new ReplayStore(detail, () => this.bounds.last);
    this.#fetcher = new WindowFetcher(detail.info.id, this.store);
  }

  get pixels(): number {
    return this.#pixels;
  }

  set pixels(width: number) {
    this.#pixels = width;
    VisibleRange.#lastPixels = width;
  }

  /** Why samples are missing. */
  get problem(): WindowFetcher["problem"] {
    return this.#fetcher.problem;
  }

  get held(): HeldWindow | undefined {
    return this.#fetcher.held;
  }

  /** The initial view of a recording opened without a place. */
  whole(extraPlots: ReadonlySet<string>): ShownChannels {
    return {
      device: this.detail.devices[0]?.id,
      t0: this.bounds.first,
      t1: this.bounds.last,
      base: "device",
      speed: 0,
      extraPlots,
      customPlots: [],
    };
  }

  /** Whether the samples of this window are loaded at screen resolution. */
  has(shown: ShownChannels): boolean {
    const { t0, t1, base, speed } = shown;
    const { held } = this.#fetcher;
    return (
      held !== undefined &&
      this.#fetcher.holds(this.#channels(shown), base) &&
      isEnough(held.stretch, held.exact, t0, t1, this.pixels, speed, this.bounds)
    );
  }

  /** Load them, unless they are loaded. */
  want(shown: ShownChannels): void {
    if (this.has(shown)) return void (this.#fetcher.problem = undefined);
    const { t0, t1, base, speed } = shown;
    const channels = this.#channels(shown);
    if (!this.#fetcher.holds(channels, base)) this.store.keepOnly(channels);
    this.#fetcher.ask({ stretch: stretchFor(t0, t1, this.pixels, speed, this.bounds), channels, base });
  }

  /** More is decoded: request the held range again. */
  refresh(): void {
    this.#fetcher.held = undefined;
  }

  dispose(): void {
    this.#fetcher.dispose();
  }

  /** Channels of the plots on screen, of the status words under them, and of the position. */
  #channels({ device, extraPlots, customPlots }: ShownChannels): readonly number[] {
    const from = this.store.channels.peek();
    const known = this.#chosen;
    const isSame = known?.from === from && known.device === device;
    if (isSame && known.extraPlots === extraPlots && known.customPlots === customPlots) return known.ids;
    const own = from.filter(({ info }) => info.device === device);
    const protocol = protocolAmong(this.store.devices.peek(), device);
    const chosen = usualPlots(own, protocol?.plots).filter(({ primary, key }) => primary !== extraPlots.has(key));
    const shown = withCustomPlots(chosen, customPlots, from, device);
    const ids = shown.flatMap(({ series }) => series.map(({ channel }) => channel.info.id));
    const status = own.filter(({ info }) => info.kind === "status").map(({ info }) => info.id);
    const track = own
      .filter(({ info }) => info.columns.some(({ name }) => /^lat/i.test(name)))
      .map(({ info }) => info.id);
    this.#chosen = {
      from,
      device,
      extraPlots,
      customPlots,
      ids: [...new Set([...ids, ...status, ...track].map((id) => (id < 0 ? -1 - id : id)))],
    };
    return this.#chosen.ids;
  }
}

/** Device times may start years off, before a receiver knows the date: those samples exist, but no axis starts with them. */
const FAR_OFF_S = 86_400;

function boundsOf({ t0, t1, info }: RecordingDetail): Bounds {
  const first = info.started !== null && t0 < info.started - FAR_OFF_S ? info.started : t0;
  return { first, last: Math.max(t1, first + 1e-3) };
}
