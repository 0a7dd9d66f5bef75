/** What extensions add to plots: marks over the traces, and the menu of a series in a legend. */
import type { Store } from "../data/store";
import type { ViewState } from "../data/view-state";
import type { Openers } from "../page/context";
import type { Palette } from "./canvas-style";
import type { PlotSpec, Series } from "../data/view";
import type { TimeWindow } from "./time-window";

declare module "../extension/extension" {
  interface Extension {
    /** What is drawn over the plots. */
    readonly plotMarks?: readonly PlotMarks[];
    /** What the menu of a series in the legend of a plot opens: that of the first that has one. */
    readonly seriesActions?: readonly SeriesAction[];
  }
}

/** A plot as marks need it, CSS px from the top of the stack. */
export interface MarkedPlot {
  readonly spec: PlotSpec;
  readonly top: number;
  readonly sheet: { readonly height: number };
  readonly y: (value: number) => number;
}

/** Marks of one stack of plots. */
export interface MarkLayer {
  /** Whether there is nothing to draw. */
  readonly isBare: () => boolean;
  /** Changes with everything that is drawn; called after `isBare`, once a frame. */
  readonly stamp: (plots: readonly MarkedPlot[]) => string;
  readonly draw: (
    x: CanvasRenderingContext2D,
    plots: readonly MarkedPlot[],
    w: TimeWindow,
    look: Palette,
    hidden: ReadonlySet<string>,
  ) => void;
}

export type PlotMarks = (store: Store, viewState: ViewState) => MarkLayer;

export interface SeriesActionContext {
  readonly store: Store;
  readonly viewState: ViewState;
  readonly open: Pick<Openers, "dialog">;
  /** Newest time of the samples. */
  readonly now: number;
}

export interface SeriesAction {
  /** The title of the series, with a word of what its menu opens. */
  readonly title: (title: string) => string;
  readonly applies: (series: Series) => boolean;
  readonly run: (series: Series, context: SeriesActionContext) => void;
}
