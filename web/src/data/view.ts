/** What a view of samples is made of: types that plots, panels and the store share. */
import type { ReadonlySignal, Signal } from "@preact/signals";
import type { Layout } from "./layout";
import type { Wish } from "./tiles";
import type { Channel } from "./channels";
import type { WorldFrame } from "./rotations";

/** The unsummarised samples of a channel around a time, if the drawn ones are summarised. */
export type Reads = (channel: Channel, t: number) => Channel;

export interface Series {
  readonly channel: Channel;
  readonly column: number;
  /** As `hidden` in view-state.ts: channel and column name. */
  readonly key: string;
  /** Words of its row, and at the end of its line. */
  readonly label: string;
  /** Name of its channel, if the plot's title does not tell it: above the row. */
  readonly heading?: string;
  /** Of a signal that the user added: names its line where the label has no room. */
  readonly mark?: string;
  readonly colour: "axis-x" | "axis-y" | "axis-z" | "axis-n";
  /** Dashes distinguish series without axis colours; empty for a solid line. */
  readonly dash: readonly number[];
  /** Of the plot's second unit: read on its right axis. */
  readonly isRight?: boolean;
  /** The norm of the others: shown in the legend, drawn only on request. */
  readonly norm: boolean;
  readonly decimals: number;
}

/** The axis on the right of a plot, for signals of a second unit. */
export interface RightAxis {
  /** Of its choices among those of all axes. */
  readonly key: string;
  readonly unit: string;
  readonly decimals: number;
}

export interface PlotSpec {
  /** Constant for the same quantity whenever channels are advertised again. */
  readonly key: string;
  readonly title: string;
  readonly unit: string;
  /** World frame of the angles or the vector, "" without one. */
  readonly frame: string;
  readonly series: readonly Series[];
  readonly decimals: number;
  /** The axis of a second unit. */
  readonly right?: RightAxis;
  /** Share of the height (design, "Grid"). */
  readonly weight: number;
  /** Shown initially. */
  readonly primary: boolean;
  /** The message of the quantity, for display; "" if the quantity is unique. */
  readonly group: string;
  /** Id of a plot that the user put together (signals/custom-plots.ts). */
  readonly custom?: string;
}

/** Which clock the x axis shows. */
export type TimeBase = "device" | "arrival";

export interface View {
  /** DeviceInfo.id of the selected device, or undefined before the first one. */
  readonly device: string | undefined;
  /** True: the right edge is now. False: it stays at `end`. */
  readonly live: boolean;
  /** Right edge of the window, unix seconds (server clock); read only when not live. */
  readonly end: number;
  /** Length of the window in seconds. */
  readonly span: number;
  readonly timeBase: TimeBase;
}

/**
 * Position of the reading cursor: under the pointer as a fraction of the plot's width (its time runs while live), or pinned to
 * a time by a click (it moves left with the data); undefined: panels read the newest sample.
 */
export type Cursor =
  | { readonly kind: "pointer"; readonly fraction: number }
  | { readonly kind: "pinned"; readonly time: number }
  | undefined;

/** One column of a channel of a device, by their names. */
export interface SignalRef {
  readonly device: string;
  readonly channel: string;
  readonly column: string;
}

/** Signals that a person put on a plot of their own or, with `on`, on a plot of a device (signals/custom-plots.ts). */
export interface CustomPlot {
  readonly id: string;
  readonly on?: { readonly device: string; readonly plot: string };
  readonly signals: readonly SignalRef[];
}

/** The order of the plots, by key, and chosen heights, px, as far as a person chose them (data/plot-order.ts). */
export interface PlotOrder {
  readonly order?: readonly string[];
  readonly heights?: Readonly<Record<string, number>>;
  /** Tiles of the plots that do not stand with the others, by key of the plot. */
  readonly tiles?: Readonly<Record<string, string>>;
}

/** Heights that the plots ask for, with what is under them; and the keys of all plots that there are. */
export interface PlotsWish extends Wish {
  readonly keys: readonly string[];
}

/** What a person chose for the y axis of a plot; without a range it follows the data. */
export interface YAxis {
  /** In the plot's unit. */
  readonly range?: readonly [low: number, high: number];
  /** Logarithmic while all values are positive. */
  readonly isLog?: boolean;
}

/** A column of a channel of the selected device, by their names. */
export type ColumnName = readonly [channel: string, column: string];

/** What a person chose for the XY plot; what is absent is at its default (xy/choice.ts). */
export interface XyChoice {
  readonly x?: ColumnName;
  readonly y?: ColumnName;
  readonly range?: "cursors";
  readonly colour?: "trail";
  readonly draw?: "points";
  readonly isEqual?: true;
  readonly pairing?: "nearest";
}

/** What a person chose for the histogram; what is absent is at its default (histogram/choice.ts). */
export interface HistogramChoice {
  readonly channel?: string;
  /** Columns of that channel. */
  readonly columns?: readonly string[];
  readonly range?: "cursors";
  readonly scale?: "density";
  /** Number of bins; absent: by their rule. */
  readonly bins?: number;
  /** Values within this many σ of the mean; absent: all. */
  readonly within?: number;
  /** The normal curve is left out. */
  readonly noCurve?: true;
}

/** What an analysis is shown of and how, as far as a person chose it; what is absent is at its default (analysis/choice.ts). */
export interface AnalysisChoice {
  /** Signals and expressions, as typed. */
  readonly signals?: string;
  readonly range?: "window" | "cursors" | "everything";
  readonly window?: string;
  /** Samples of a segment; absent: automatic. */
  readonly length?: number;
  readonly scale?: "power";
  readonly frequencyAxis?: "log";
  readonly motion?: "include";
  readonly temperature?: "include";
}

export type AnalysisPanel = "psd" | "spectrogram" | "allan";

export interface ViewSignals {
  readonly view: Signal<View>;
  readonly cursor: Signal<Cursor>;
  /** Cursor B, for measuring against the pinned reading cursor, which is A: unix seconds. */
  readonly measure: Signal<number | undefined>;
  /** Whether cursors are put on samples. */
  readonly snap: Signal<boolean>;
  readonly yAxes: Signal<ReadonlyMap<string, YAxis>>;
  /** The plot whose y axis is being chosen, and the range that it has. */
  readonly yAxisForm: Signal<{ readonly key: string; readonly range: readonly [number, number] } | undefined>;
  /** Series hidden by the user, as `${channelName}.${columnName}`. */
  readonly hiddenSeries: Signal<ReadonlySet<string>>;
  /** Norms seen so far, by the same keys: each is hidden once, when first seen, because the legend shows it and it is drawn on request. */
  readonly knownNorms: Set<string>;
  /** Further quantities added by the user, by plot key. Outlives a remount of the plots. */
  readonly extraPlots: Signal<ReadonlySet<string>>;
  /** Plots put together by the user, and what was added to others. */
  readonly customPlots: Signal<readonly CustomPlot[]>;
  /** Frame in which attitude is shown; undefined: as the device sends it. Views of one store share it: the store converts its samples. */
  readonly frame: Signal<WorldFrame | undefined>;
  readonly plotOrder: Signal<PlotOrder>;
  readonly xy: Signal<XyChoice>;
  readonly histogram: Signal<HistogramChoice>;
  readonly analyses: Signal<{ readonly [panel in AnalysisPanel]?: AnalysisChoice }>;
  /** Where the panels are. */
  readonly layout: Signal<Layout>;
  readonly plotsWish: Signal<PlotsWish>;
}

/** Parts of `view`, for what is redrawn when one changes: the view itself changes with every frame of a drag. */
export interface ViewParts {
  readonly device: ReadonlySignal<View["device"]>;
  readonly isLive: ReadonlySignal<boolean>;
  readonly span: ReadonlySignal<number>;
  readonly timeBase: ReadonlySignal<TimeBase>;
}
