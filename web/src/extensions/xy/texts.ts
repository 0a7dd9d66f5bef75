/** Texts of the XY plot. */
import { count } from "../../texts/plural";
import type { Value } from "../../wire/texts";

export const TEXT = {
  title: "XY plot",
  x: "x",
  y: "y",
  swap: "Swap x and y",
  colour: "Time as",
  byTime: "Colour",
  trail: "Trail",
  draw: "Draw",
  line: "Line",
  points: "Points",
  equal: "Equal scale",
  equalHint: "The same length for a unit on both axes",
  pairing: "Between samples",
  interpolated: "Interpolate",
  nearest: "Nearest",
  canvas: (y: Value, x: Value, samples: Value) =>
    `${y} over ${x}, ${samples}. Arrow keys move the cursor along the samples.`,
  samples: (n: number) => count(n, "sample"),
  thinned: (drawn: Value) => `${drawn} drawn, with the extremes of x and y`,
  sameTimes: "same sample times",
  atTimesOf: (leader: Value, follower: Value, isNearest: boolean) =>
    `at the times of ${leader}, ${follower} ${isNearest ? "nearest sample" : "interpolated"}`,
  earlier: "earlier",
  later: "later",
  none: "No samples of both signals in this range.",
  noSignals: "This device sends no numbers to plot.",
  loading: "Loading…",
  frameUnknown: (signal: Value) =>
    `The server cannot compute ${signal} in this frame. Choose another frame or a shorter range.`,
};
