/** The picture of an XY plot: both axes, the pairs with their time as colour or as a trail that fades, and the cursors. */
import { colourAt } from "../../charts/colours";
import { css, font, type Surface } from "../../ui/dom/canvas";
import { number } from "../../ui/format/format";
import { type Scale, ticks } from "../../charts/scale";
import type { Pairs } from "./pairs";

const [LEFT, BOTTOM, TOP, RIGHT] = [60, 36, 22, 14];
/** Steps of colour, or of opacity. */
const COLOUR_STEPS = 40;
/** Ends of the colours, as shares of their scale: the oldest is nearest to the background, and still stands out. */
const COLOURS = { dark: [0.32, 1], light: [0.72, 0.04] } as const;
/** Opacity of the oldest part of a trail. */
const MIN_ALPHA = 0.12;
const LINE_PX = 1.2;
const POINT_PX = 2.5;
/** Nearer pairs are one point, px. */
const SAME_PX = 0.6;
const TICK_PX = { x: 64, y: 30 };

export interface Drawing {
  readonly pairs: Pairs;
  readonly t0: number;
  readonly t1: number;
  readonly scales: { readonly x: Scale; readonly y: Scale };
  readonly names: { readonly x: string; readonly y: string };
  readonly isTrail: boolean;
  readonly isPoints: boolean;
  readonly isEqual: boolean;
  /** The pairs belong to another range than the requested one. */
  readonly isOld: boolean;
  readonly marks: readonly { readonly letter: string; readonly x: number; readonly y: number }[];
}

/** Places of values, px. */
export interface PlacedSample {
  readonly x: (value: number) => number;
  readonly y: (value: number) => number;
}

export function isLight(): boolean {
  return document.documentElement.dataset["theme"] === "light";
}

/** The colour of a moment: 0 is the earliest, 1 the latest. */
export function timeColour(share: number, light = isLight()): string {
  const [oldest, newest] = COLOURS[light ? "light" : "dark"];
  return `rgb(${colourAt(oldest + share * (newest - oldest)).join(" ")})`;
}

/** @returns where values are; undefined without room */
export function drawXy(to: Surface, of: Drawing): PlacedSample | undefined {
  const [width, height] = [to.width() - LEFT - RIGHT, to.height() - TOP - BOTTOM];
  if (width < 40 || height < 40 || !to.begin()) return undefined;
  const x = to.context;
  const ends = { x: [of.scales.x.lo, of.scales.x.hi], y: [of.scales.y.lo, of.scales.y.hi] } as {
    x: [number, number];
    y: [number, number];
  };
  if (of.isEqual) makeEqual(ends, width, height);
  const place: PlacedSample = {
    x: (value) => LEFT + ((value - ends.x[0]) / (ends.x[1] - ends.x[0])) * width,
    y: (value) => TOP + ((ends.y[1] - value) / (ends.y[1] - ends.y[0])) * height,
  };
  drawGrid(x, ends, place, width, height);
  x.fillStyle = css("--ink-2");
  font(x, 11.5, 500);
  x.textBaseline = "alphabetic";
  x.textAlign = "left";
  x.fillText(of.names.y, 4, 13, LEFT + width);
  x.textAlign = "right";
  x.fillText(of.names.x, LEFT + width, TOP + height + 31, width);
  x.save();
  x.beginPath();
  x.rect(LEFT, TOP, width, height);
  x.clip();
  drawPairs(x, of, place);
  x.restore();
  for (const mark of of.marks) drawMark(x, place.x(mark.x), place.y(mark.y), mark.letter);
  return place;
}

/** Widen the range of one axis about its middle, so that a unit has the same length on both. */
export function makeEqual(ends: { x: [number, number]; y: [number, number] }, width: number, height: number): void {
  const per = Math.max((ends.x[1] - ends.x[0]) / width, (ends.y[1] - ends.y[0]) / height);
  for (const [axis, px] of [
    ["x", width],
    ["y", height],
  ] as const) {
    const middle = (ends[axis][0] + ends[axis][1]) / 2;
    ends[axis] = [middle - (per * px) / 2, middle + (per * px) / 2];
  }
}

function drawGrid(
  x: CanvasRenderingContext2D,
  ends: { readonly x: readonly [number, number]; readonly y: readonly [number, number] },
  place: PlacedSample,
  width: number,
  height: number,
): void {
  font(x, 10.5);
  x.textBaseline = "middle";
  for (const axis of ["x", "y"] as const) {
    const isX = axis === "x";
    x.textAlign = isX ? "center" : "right";
    for (const { value, decimals } of ticks(...ends[axis], isX ? width : height, false, TICK_PX[axis])) {
      const at = Math.round(place[axis](value)) + 0.5;
      x.fillStyle = css(value === 0 ? "--grid-zero" : "--grid");
      if (isX) x.fillRect(at, TOP, 1, height);
      else x.fillRect(LEFT, at, width, 1);
      x.fillStyle = css("--ink-3");
      const text = number(value, decimals);
      if (isX) x.fillText(text, at, TOP + height + 11);
      else x.fillText(text, LEFT - 6, at, LEFT - 8);
    }
  }
  x.fillStyle = css("--line");
  x.fillRect(LEFT, TOP, 1, height);
  x.fillRect(LEFT, TOP + height, width, 1);
}

function drawPairs(x: CanvasRenderingContext2D, of: Drawing, place: PlacedSample): void {
  const { pairs, t0, t1, isTrail, isPoints } = of;
  const { time, x: xs, y: ys, starts } = pairs;
  const step = COLOUR_STEPS / Math.max(t1 - t0, 1e-9);
  const faded = of.isOld ? 0.6 : 1;
  const [light, trail] = [isLight(), css("--axis-z")];
  x.lineWidth = LINE_PX;
  x.lineJoin = "bevel";
  x.lineCap = "round";
  let [bin, px, py] = [-1, NaN, NaN];
  for (let k = 0; k < time.length; k++) {
    const now = Math.min(COLOUR_STEPS - 1, Math.max(0, Math.floor((time[k]! - t0) * step)));
    const [u, v] = [place.x(xs[k]!), place.y(ys[k]!)];
    const isStart = k === 0 || starts[k] === 1;
    if (now !== bin) {
      if (!isPoints && bin >= 0) x.stroke();
      bin = now;
      const share = bin / (COLOUR_STEPS - 1);
      x.strokeStyle = x.fillStyle = isTrail ? trail : timeColour(share, light);
      x.globalAlpha = faded * (isTrail ? MIN_ALPHA + share * (1 - MIN_ALPHA) : 1);
      x.beginPath();
      if (!isStart) x.moveTo(px, py);
    } else if (!isStart && Math.abs(u - px) + Math.abs(v - py) < SAME_PX) continue;
    if (isPoints) x.fillRect(u - POINT_PX / 2, v - POINT_PX / 2, POINT_PX, POINT_PX);
    else if (isStart) {
      x.moveTo(u, v);
      x.lineTo(u, v); // a lone pair is a dot
    } else x.lineTo(u, v);
    [px, py] = [u, v];
  }
  if (!isPoints && bin >= 0) x.stroke();
  x.globalAlpha = 1;
}

function drawMark(x: CanvasRenderingContext2D, u: number, v: number, letter: string): void {
  if (!(u === u && v === v)) return;
  x.lineWidth = 4;
  x.strokeStyle = css("--bg");
  x.beginPath();
  x.arc(u, v, 6, 0, 2 * Math.PI);
  x.stroke();
  x.lineWidth = 2;
  x.strokeStyle = css("--yours");
  x.beginPath();
  x.arc(u, v, 6, 0, 2 * Math.PI);
  x.stroke();
  if (letter === "") return;
  font(x, 11, 650);
  x.textAlign = "left";
  x.textBaseline = "middle";
  x.fillStyle = css("--yours");
  x.fillText(letter, u + 10, v);
}

/** The pair nearest to a point of the picture, within `reach` px; −1 without one. */
export function nearestPair(pairs: Pairs, place: PlacedSample, u: number, v: number, reach = 28): number {
  let [best, least] = [-1, reach * reach];
  for (let k = 0; k < pairs.time.length; k++) {
    const [du, dv] = [place.x(pairs.x[k]!) - u, place.y(pairs.y[k]!) - v];
    const square = du * du + dv * dv;
    if (square < least) [best, least] = [k, square];
  }
  return best;
}
