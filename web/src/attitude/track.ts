/** Where did it go? The window's track in metres, north up, with a scale bar. */
import { css, font, type Surface } from "../ui/canvas";
import { number } from "../ui/format";

export type Point = readonly [east: number, north: number];

/** The longest round length (1, 2 or 5 times a power of ten) not above `metres`. */
export function roundLength(metres: number): number {
  const power = 10 ** Math.floor(Math.log10(metres));
  const digit = metres / power;
  return (digit >= 5 ? 5 : digit >= 2 ? 2 : 1) * power;
}

/** Draws `points`, oldest first; `here` is the one that is read now. A break in the track is an undefined. */
export function drawTrack(to: Surface, points: readonly (Point | undefined)[], here: Point | undefined): void {
  if (!to.begin()) return;
  const known = points.filter((point) => point !== undefined);
  const x = to.context;
  const [w, h] = [to.width(), to.height()];
  if (known.length === 0) {
    font(x, 11.5);
    x.fillStyle = css("--ink-3");
    x.textAlign = "center";
    x.textBaseline = "middle";
    x.fillText("No position in this window", w / 2, h / 2);
    return;
  }
  const east = known.map((point) => point[0]);
  const north = known.map((point) => point[1]);
  const middle: Point = [(Math.min(...east) + Math.max(...east)) / 2, (Math.min(...north) + Math.max(...north)) / 2];
  // A receiver at rest wanders by a metre: the picture never shows less than two across.
  const wide = Math.max(2, Math.max(...east) - Math.min(...east));
  const tall = Math.max(2, Math.max(...north) - Math.min(...north));
  const scale = Math.min((w - 40) / wide, (h - 24) / tall);
  const place = (p: Point): Point => [w / 2 + (p[0] - middle[0]) * scale, h / 2 - (p[1] - middle[1]) * scale];
  const length = roundLength((w * 0.4) / scale);
  drawGrid(x, w, h, length * scale);
  drawLine(x, points, place);
  if (here) drawHere(x, place(here));
  font(x, 10.5);
  x.fillStyle = css("--ink-3");
  x.textAlign = "right";
  x.textBaseline = "alphabetic";
  x.fillText(`${number(length, length < 1 ? 1 : 0)} m`, w - 4, h - 8);
  x.fillRect(w - 4 - length * scale, h - 5, length * scale, 1.5);
}

function drawGrid(x: CanvasRenderingContext2D, w: number, h: number, step: number): void {
  x.fillStyle = css("--grid");
  for (let u = (w / 2) % step; u < w; u += step) x.fillRect(Math.round(u), 0, 1, h);
  for (let v = (h / 2) % step; v < h; v += step) x.fillRect(0, Math.round(v), w, 1);
}

function drawLine(x: CanvasRenderingContext2D, points: readonly (Point | undefined)[], place: (p: Point) => Point): void {
  x.strokeStyle = css("--ink-2");
  x.lineWidth = 1.75;
  x.lineJoin = x.lineCap = "round";
  x.beginPath();
  let pen = false;
  for (const point of points) {
    if (point) {
      const [u, v] = place(point);
      if (pen) x.lineTo(u, v);
      else x.moveTo(u, v);
    }
    pen = point !== undefined;
  }
  x.stroke();
}

function drawHere(x: CanvasRenderingContext2D, [u, v]: Point): void {
  x.beginPath();
  x.arc(u, v, 4, 0, 7);
  x.fillStyle = css("--ink");
  x.fill();
  x.lineWidth = 1.5;
  x.strokeStyle = css("--bg");
  x.stroke();
}
