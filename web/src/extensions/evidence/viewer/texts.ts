/** Texts of evidence: the dialog that makes it, and the viewer in the file. */
import type { Value } from "../../../wire/texts";

export const TEXT = {
  zoomIn: "Zoom in",
  zoomOut: "Zoom out",
  whole: "Whole range",
  toCursors: "A to B",
  clear: "Remove cursors",
  sets: "A tap or click sets",
  cursor: { a: "A", b: "B" },
  at: (name: Value, time: Value) => `${name} ${time}`,
  apart: (time: Value, frequency: Value) => `Δt ${time}, 1/Δt ${frequency}`,
  hint: "Wheel or pinch zooms, dragging moves; click sets A, with Shift B. Keys: ← → + − 0, A and B set a cursor, comma and period move A by a sample, with Shift B.",
  plots: "Plots",
  canvas: (title: Value, unit: Value, from: Value, to: Value) =>
    `${title} in ${unit || "its unit"}, ${from} to ${to} UTC`,
  measured: "Measured between A and B",
  measuredHint: "Of the samples in this file.",
  measuredThinned: "Of the samples in this file. Where the file has only extremes, Δ and mean are missing.",
  heads: ["signal", "A", "B", "Δ", "min", "max", "mean", "samples"],
  extremes: (low: Value, high: Value) => `${low} … ${high}`,
};
