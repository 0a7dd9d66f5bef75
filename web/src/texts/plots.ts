/** Texts of the plots. */
import { count } from "./plural";
import type { Value } from "../wire/texts";

export const TEXT = {
  // derived channels
  normDoc: "Magnitude of the vector, computed by the page.",
  eulerAngles: "Euler angles",
  rollDoc: "Rotation about x, third in the sequence.",
  pitchDoc: "Rotation about y, second in the sequence.",
  yawDoc: "Rotation about z, first in the sequence.",
  eulerAnglesDoc: (title: Value) => `Computed by the page from ${title}; sequence yaw, pitch, roll.`,

  // losses
  droppedForBrowser: "Dropped for this browser because it could not keep up.",
  serverRestartedGap: "The imuscope server was restarted; data sent in the meantime are missing here.",

  // axis
  minutesSeconds: (sign: Value, minutes: Value, seconds: Value) => `${sign}${minutes} min ${seconds} s`,
  deviceTime: "device time",
  arrivalTime: "arrival time",
  utcDay: (day: Value, base: Value) => `UTC ${day}, ${base}`,
  utcBase: (base: Value) => `UTC, ${base}`,
  cursorA: (time: Value) => `A ${time}`,
  measured: (duration: Value) => `B Δ ${duration}`,

  // history strip
  inMemory: "In memory",
  secondsBehind: (seconds: Value) => `${seconds} s behind`,
  minutesBehind: (minutes: Value, seconds: Value) => `${minutes} min ${seconds} s behind`,

  // lane names
  fewerLanes: "Fewer lanes",
  moreLanes: (others: number) => count(others, "more lane"),
  lossHere: (loss: Value) => `Loss: ${loss}`,
  noLoss: "No gap known.",
  gapsInMemory: (losses: number) => `${count(losses, "gap")} in memory.`,
  whenSet: (meaning: Value) => `When set: ${meaning}`,

  // legend
  unverifiedHint: "Unverified: the sender could not be verified",
  unverified: "unverified",
  frameOf: (frame: Value) => `Frame: ${frame}.`,
  toggleSeries: (name: Value, label: Value) => `${name} ${label}: click to hide or show, Shift-click to show alone`,
  onRightAxis: (name: Value, label: Value) => `${name} ${label}, right axis`,
  removePlot: (title: Value) => `Remove the plot ${title}`,
  change: (difference: Value) => `Δ ${difference}`,

  // plot selection
  rollPitch: "Roll, pitch",
  yaw: "Yaw",

  // plot stack
  moreQuantities: "More quantities",
  allSignals: "All signals…",
  allSignalsHint: "Search all signals, and put them on any plot (S)",
  statusLanesLabel: "Losses and status flags over time",
  everythingInMemory: "Everything in memory",
  lastSeconds: (span: Value) => `last ${span} s`,
  secondsUntil: (span: Value, end: Value) => `${span} s until ${end} UTC`,
  timeAxisState: (range: Value, cursor: Value) => `Time axis, ${range}${cursor}`,

  // order and heights
  heightHint: "Drag: height of the plot; double click: automatic",
  moveHint: "Drag the title to move the plot",

  // plot
  inUnit: (unit: Value) => ` in ${unit}`,
  plotOverTime: (title: Value, unit: Value) => `${title}${unit} over time`,

  // y axis
  yAxisHint: "Wheel or two fingers: zoom; drag: move; click: range; double click: automatic",
  rightOf: (title: Value) => `${title}, right`,
  yAxisOf: (title: Value) => `y axis of ${title}`,
  yAxisAutomatic: (title: Value) => `y axis of ${title}, automatic`,
  yAxisFixed: (title: Value, low: Value, high: Value, unit: Value) =>
    `y axis of ${title}, fixed from ${low} to ${high} ${unit}`.trimEnd(),
  logarithmic: "logarithmic",
  fixed: "fixed",
  log: "log",
  minimum: "Minimum",
  maximum: "Maximum",
  logarithmicAxis: "Logarithmic",
  logHint: "A logarithmic axis is drawn while all values in the window are positive.",
  notANumber: "Minimum and maximum must be numbers, for example −2.5.",
  wrongOrder: (low: Value, high: Value) => `The minimum ${low} must be below the maximum ${high}.`,
  logNeedsPositive: (low: Value) => `The minimum ${low} must be above 0 on a logarithmic axis.`,
  automatic: "Automatic",
  fix: "Fix range",

  // status lanes
  lanes: "Lanes",
  notSet: "not set",
  samplesThen: (samples: number) => `${count(samples, "sample")}, `,
  thisBrowser: ", this browser",
  serverRestarted: ", server restarted",

  // plot stack
  cursorAtUtc: (reading: Value) => `, cursor at ${reading} UTC`,
};
