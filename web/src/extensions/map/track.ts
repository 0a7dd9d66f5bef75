/** The track in metres on a plain grid, north up, with a scale bar; the line style shows the kind of fix. */
import { css, font, type Surface } from "../../ui/dom/canvas";
import { number } from "../../ui/format/format";
import type { Quality } from "./position";
import { TEXT } from "./texts";

export type GridPoint = readonly [east: number, north: number];

export interface TrackPoint {
  readonly at: GridPoint;
  readonly quality: Quality;
}

/** View of the track: the point in its middle, and px per metre. */
export interface TrackView {
  readonly middle: GridPoint;
  readonly scale: number;
}

/** Line style and label of each kind of fix. */
export const STYLES: Readonly<
  Record<Exclude<Quality, "none">, { readonly width: number; readonly dash: readonly number[]; readonly word: string }>
> = {
  fixed: { width: 2.75, dash: [], word: TEXT.rtkFixed },
  float: { width: 2, dash: [8, 4], word: TEXT.rtkFloating },
  plain: { width: 1.5, dash: [], word: "3D" },
  poor: { width: 1.75, dash: [1.5, 4], word: TEXT.fix2d },
};

/** The longest round length (1, 2 or 5 times a power of ten) not above `metres`. */
export function roundLength(metres: number): number {
  const power = 10 ** Math.floor(Math.log10(metres));
  const digit = metres / power;
  return (digit >= 5 ? 5 : digit >= 2 ? 2 : 1) * power;
}

/** The view that shows all points; undefined without any. */
export function fitView(points: readonly (TrackPoint | undefined)[], w: number, h: number): TrackView | undefined {
  let [west, east, south, north] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const point of points) {
    if (!point) continue;
    [west, east] = [Math.min(west, point.at[0]), Math.max(east, point.at[0])];
    [south, north] = [Math.min(south, point.at[1]), Math.max(north, point.at[1])];
  }
  if (west > east) return undefined;
  // A receiver at rest wanders by a metre: the picture never shows less than two across.
  const scale = Math.min(
    Math.max(10, w - 40) / Math.max(2, east - west),
    Math.max(10, h - 24) / Math.max(2, north - south),
  );
  return { middle: [(west + east) / 2, (south + north) / 2], scale };
}

/** The view after `factor` more px a metre about a place on the picture. */
export function zoomedTrack(view: TrackView, factor: number, u: number, v: number, w: number, h: number): TrackView {
  const scale = Math.min(1e4, Math.max(1e-4, view.scale * factor));
  const shift = 1 / view.scale - 1 / scale;
  return { middle: [view.middle[0] + (u - w / 2) * shift, view.middle[1] - (v - h / 2) * shift], scale };
}

/** Segments of one quality; a break (undefined) or no fix ends one, and a change of quality joins on. */
export function stretches(
  points: readonly (TrackPoint | undefined)[],
): readonly { readonly quality: Exclude<Quality, "none">; readonly points: readonly GridPoint[] }[] {
  const found: { quality: Exclude<Quality, "none">; points: GridPoint[] }[] = [];
  let last: TrackPoint | undefined;
  for (const point of points) {
    const quality = point?.quality ?? "none";
    if (point && quality !== "none") {
      const joins = last !== undefined && last.quality !== "none";
      if (joins && last!.quality === quality) found.at(-1)!.points.push(point.at);
      else found.push({ quality, points: joins ? [last!.at, point.at] : [point.at] });
    }
    last = quality === "none" ? undefined : point;
  }
  return found;
}

/** Draws the ground under the track; true if lines on it need an outline. */
export type Ground = (view: TrackView, place: (point: GridPoint) => GridPoint) => boolean;

/** Draws `points`, oldest first; `here` is the reading position. Returns the view, fitted if none is given. */
export function drawTrack(
  to: Surface,
  points: readonly (TrackPoint | undefined)[],
  here: GridPoint | undefined,
  wanted?: TrackView,
  ground?: Ground,
): TrackView | undefined {
  if (!to.begin()) return wanted;
  const x = to.context;
  const [w, h] = [to.width(), to.height()];
  const view = wanted ?? fitView(points, w, h);
  if (!view) {
    font(x, 11.5);
    x.fillStyle = css("--ink-3");
    x.textAlign = "center";
    x.textBaseline = "middle";
    x.fillText(TEXT.noPositionInWindow, w / 2, h / 2);
    return undefined;
  }
  const place = ([east, north]: GridPoint): GridPoint => [
    w / 2 + (east - view.middle[0]) * view.scale,
    h / 2 - (north - view.middle[1]) * view.scale,
  ];
  const length = roundLength(Math.min(w * 0.4, 220) / view.scale);
  const covered = ground?.(view, place) ?? false;
  if (!covered) drawGrid(x, w, h, place([0, 0]), length * view.scale);
  for (const stretch of stretches(points)) drawLine(x, stretch.quality, stretch.points.map(place), covered);
  if (here) drawHere(x, place(here));
  drawMarks(x, w, h, length, view.scale, covered);
  return view;
}

/** Lines every `step` px, through the origin of the track, so that they move with it. */
function drawGrid(x: CanvasRenderingContext2D, w: number, h: number, [u0, v0]: GridPoint, step: number): void {
  x.fillStyle = css("--grid");
  for (let u = ((u0 % step) + step) % step; u < w; u += step) x.fillRect(Math.round(u), 0, 1, h);
  for (let v = ((v0 % step) + step) % step; v < h; v += step) x.fillRect(0, Math.round(v), w, 1);
}

function drawLine(
  x: CanvasRenderingContext2D,
  quality: Exclude<Quality, "none">,
  points: readonly GridPoint[],
  edged: boolean,
): void {
  const { width, dash } = STYLES[quality];
  x.lineJoin = "round";
  x.lineCap = dash.length > 0 ? "butt" : "round";
  x.setLineDash([...dash]);
  x.beginPath();
  points.forEach(([u, v], k) => (k === 0 ? x.moveTo(u, v) : x.lineTo(u, v)));
  const [first] = points;
  if (points.length === 1 && first) x.lineTo(first[0] + 0.01, first[1]);
  if (edged) {
    x.strokeStyle = css("--bg");
    x.lineWidth = width + 3.5;
    x.setLineDash([]);
    x.stroke();
    x.setLineDash([...dash]);
  }
  x.strokeStyle = css(edged ? "--ink" : "--ink-2");
  x.lineWidth = width;
  x.stroke();
  x.setLineDash([]);
}

function drawHere(x: CanvasRenderingContext2D, [u, v]: GridPoint): void {
  x.beginPath();
  x.arc(u, v, 4.5, 0, 7);
  x.fillStyle = css("--ink");
  x.fill();
  x.lineWidth = 1.5;
  x.strokeStyle = css("--bg");
  x.stroke();
}

/** Scale bar at the lower right, north at the upper left. */
function drawMarks(
  x: CanvasRenderingContext2D,
  w: number,
  h: number,
  length: number,
  scale: number,
  covered: boolean,
): void {
  font(x, 10.5);
  if (covered) {
    x.fillStyle = css("--bg");
    x.fillRect(w - 14 - length * scale, h - 24, length * scale + 14, 24);
    x.fillRect(0, 0, 18, 28);
  }
  x.fillStyle = css("--ink-3");
  x.textBaseline = "alphabetic";
  x.textAlign = "right";
  const [value, unit] = length >= 1000 ? [length / 1000, "km"] : [length, "m"];
  x.fillText(`${number(value, value < 0.1 ? 2 : value < 1 ? 1 : 0)} ${unit}`, w - 4, h - 8);
  x.fillRect(w - 4 - length * scale, h - 5, length * scale, 1.5);
  x.beginPath();
  x.moveTo(8, 3);
  x.lineTo(12, 12);
  x.lineTo(8, 10);
  x.lineTo(4, 12);
  x.fill();
  x.textAlign = "center";
  x.fillText("N", 8, 23);
}
