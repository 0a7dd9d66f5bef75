/** Texts of the tree of signals, and of plots that the user puts together. */
import type { Value } from "../wire/texts";
import { count } from "./plural";

export const TEXT = {
  // plots
  ofDevice: (device: Value) => `#${device}`,
  noUnit: "no unit",
  otherUnit: (unit: Value, plot: Value, of: Value) =>
    `A plot has at most two units: ${plot} has ${of}, this signal is in ${unit}. Put it on a new plot.`,
  and: " and ",

  // tree
  signals: "Signals",
  treeLabel: "Signals of all devices",
  search: "Search signals",
  searchHint: "Name, unit or frame: gyro z, m/s²",
  nothingFound: (search: Value) => `No signal matches “${search}”.`,
  noSignals: "No device sends signals.",
  hertz: (rate: Value) => `${rate} Hz`,
  unfold: (name: Value) => `Unfold ${name}`,
  fold: (name: Value) => `Fold ${name}`,
  plot: (name: Value) => `Plot ${name} on a new plot`,
  choose: (name: Value) => `Plot ${name} on:`,
  newPlot: "New plot",
  plotFound: (name: Value) => `Plot ${name} on a new plot`,
  plotFoundHint: "Enter in the search field does it too",
  nothingChosen: "Select signals (Ctrl and Shift select several), or drag them onto a plot.",
  severalSignals: (signals: number) => count(signals, "signal"),
  addedNew: (name: Value) => `On a new plot: ${name}.`,
  addedTo: (name: Value, plot: Value) => `On the plot ${plot}: ${name}.`,
  removedFrom: (name: Value, plot: Value) => `Off the plot ${plot}: ${name}.`,
  differentUnits: "Its columns have more than two units. Select one of them.",
  resting: "no samples",
};
