/** Texts of the histogram. */
import { count } from "../../texts/plural";
import type { Value } from "../../wire/texts";

export const TEXT = {
  title: "Histogram",
  channel: "Quantity",
  columns: "Signals",
  scale: "Scale",
  counts: "Counts",
  density: "Density",
  bins: "Bins",
  automatic: "automatic",
  within: "Values",
  all: "all",
  withinSigma: (sigmas: Value) => `±${sigmas} σ`,
  curve: "Normal curve",
  curveHint: "The normal distribution with the same mean and σ",
  chart: (signals: Value) => `Histogram of ${signals}`,
  countAxis: "Samples per bin",
  densityAxis: (unit: Value) => (unit === "" ? "Density" : `Density, 1/(${unit})`),
  table: "Figures of the histogram",
  signal: "Signal",
  samples: "Samples",
  mean: "Mean ± σ",
  least: "Minimum",
  greatest: "Maximum",
  binWidth: "Bin width",
  outside: "Outside",
  outsideHint: "Samples below and above the values shown",
  clipped: (n: number) => `${count(n, "sample")} at the same extreme value: the signal may be clipped`,
  noSignals: "This device sends no numbers to count.",
  loading: "Loading…",
  binReading: (low: Value, high: Value, unit: Value) => `${low} to ${high} ${unit}`.trimEnd(),
  frameUnknown: (signal: Value) =>
    `The server cannot compute ${signal} in this frame. Choose another frame or a shorter range.`,
};
