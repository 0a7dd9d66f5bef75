/**
 * The state of one view of samples: device, time window, cursors, and which series and plots are shown. Plots, panels and keys
 * of a view share it; it is small, reactive and holds no samples. A page may have several views beside each other.
 */
import type { View, Cursor, PlotOrder, YAxis, XyChoice, HistogramChoice, ViewSignals, ViewParts } from "./view";
import { computed, signal } from "@preact/signals";
import type { WorldFrame } from "./rotations";
import { DEFAULT_ORDER } from "./plot-order";
import { DEFAULT_LAYOUT } from "./layout";
import { ViewActions } from "./view-actions";

export interface ViewState extends ViewSignals, ViewParts {
  readonly actions: ViewActions;
}

/** @param like another view: the new one shows the same series, plots and panels at first, and shares its frame */
export function createViewState(like?: ViewSignals): ViewState {
  const signals: ViewSignals = {
    view: signal<View>({ device: undefined, live: true, end: 0, span: 20, timeBase: "device" }),
    cursor: signal<Cursor>(undefined),
    measure: signal<number | undefined>(undefined),
    snap: signal(like?.snap.peek() ?? false),
    yAxes: signal<ReadonlyMap<string, YAxis>>(like?.yAxes.peek() ?? new Map()),
    yAxisForm: signal(undefined),
    hiddenSeries: signal(like?.hiddenSeries.peek() ?? new Set<string>()),
    knownNorms: new Set(like?.knownNorms),
    extraPlots: signal(like?.extraPlots.peek() ?? new Set<string>()),
    customPlots: signal(like?.customPlots.peek() ?? []),
    frame: like?.frame ?? signal<WorldFrame | undefined>(undefined),
    plotOrder: signal<PlotOrder>(like?.plotOrder.peek() ?? DEFAULT_ORDER),
    xy: signal<XyChoice>(like?.xy.peek() ?? {}),
    histogram: signal<HistogramChoice>(like?.histogram.peek() ?? {}),
    analyses: signal(like?.analyses.peek() ?? {}),
    layout: signal(like?.layout.peek() ?? DEFAULT_LAYOUT),
    plotsWish: signal(like?.plotsWish.peek() ?? { height: 660, least: 240, grows: true, keys: [] }),
  };
  const { view } = signals;
  const parts: ViewParts = {
    device: computed(() => view.value.device),
    isLive: computed(() => view.value.live),
    span: computed(() => view.value.span),
    timeBase: computed(() => view.value.timeBase),
  };
  return { ...signals, ...parts, actions: new ViewActions(signals) };
}

/** Whether two cursors are set. */
export function hasCursors({ cursor, measure }: Pick<ViewState, "cursor" | "measure">): boolean {
  return cursor.value?.kind === "pinned" && measure.value !== undefined;
}
