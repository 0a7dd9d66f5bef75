/** Attitude of the sensor as a turning box with its own axes, over a floor labelled with the frame's axes. */
import { css, font, type Surface } from "../ui/dom/canvas";
import type { Matrix3, Vector3, WorldFrame } from "../data/rotations";
import { apply, axesOf, type Camera, project } from "./projection";

/** The viewer stands south-west and above, looking north-east: north goes away to the left, east to the right. */
const CAMERA: Camera = { azimuth: 0.62, elevation: 0.46 };
/** Height of the words over the body, px. */
const CAPTION_PX = 26;
/** Half length, half width and half height of the box, along x, y and z. */
const BOX: Vector3 = [0.5, 0.36, 0.17];
const ARROWS: readonly { readonly letter: "x" | "y" | "z"; readonly tip: Vector3 }[] = [
  { letter: "x", tip: [1.12, 0, 0] },
  { letter: "y", tip: [0, 0.98, 0] },
  { letter: "z", tip: [0, 0, 0.95] },
];
/** Corners 0-3 below, 4-7 above, in turn about z. */
const FACES = [
  [0, 1, 2, 3],
  [4, 5, 6, 7],
  [0, 1, 5, 4],
  [1, 2, 6, 5],
  [2, 3, 7, 6],
  [3, 0, 4, 7],
] as const;
const FLOOR = -0.62;
const EXTENT = 1.2;

/** Draws a body turned by `enu` (world from body, ENU); the floor is labelled with the axes of `frame`, or with `letters` for them. */
export function drawBody(to: Surface, enu: Matrix3 | undefined, frame: WorldFrame, letters: string = frame): void {
  if (!to.begin()) return;
  const x = to.context;
  const scale = Math.min(to.width(), to.height() - CAPTION_PX) * 0.38;
  const at = (p: Vector3): Vector3 => {
    const [right, up, away] = project(CAMERA, p);
    return [to.width() / 2 + right * scale, (to.height() + CAPTION_PX) / 2 - up * scale, away];
  };
  x.lineCap = "round";
  drawFloor(x, at, frame, letters);
  if (!enu) return;
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k): Vector3 => {
    const [l, w, h] = BOX;
    return apply(enu, [k % 4 === 0 || k % 4 === 3 ? -l : l, k % 4 < 2 ? -w : w, k < 4 ? -h : h]);
  });
  drawShadow(x, at, corners);
  const arrows = ARROWS.map(({ letter, tip }) => ({ letter, tip: apply(enu, tip) }));
  const behind = arrows.filter((arrow) => at(arrow.tip)[2] > 0.15);
  for (const arrow of behind) drawArrow(x, at, arrow.letter, arrow.tip);
  drawBox(x, at, corners);
  for (const arrow of arrows) if (!behind.includes(arrow)) drawArrow(x, at, arrow.letter, arrow.tip);
}

type Place = (p: Vector3) => Vector3;

function line(x: CanvasRenderingContext2D, at: Place, from: Vector3, to: Vector3): void {
  const [a, b] = [at(from), at(to)];
  x.beginPath();
  x.moveTo(a[0], a[1]);
  x.lineTo(b[0], b[1]);
  x.stroke();
}

function drawFloor(x: CanvasRenderingContext2D, at: Place, frame: WorldFrame, letters: string): void {
  x.strokeStyle = css("--grid-zero");
  x.lineWidth = 1;
  for (let k = -3; k <= 3; k++) {
    line(x, at, [k * 0.4, -EXTENT, FLOOR], [k * 0.4, EXTENT, FLOOR]);
    line(x, at, [-EXTENT, k * 0.4, FLOOR], [EXTENT, k * 0.4, FLOOR]);
  }
  font(x, 10.5, 500);
  x.textAlign = "center";
  x.textBaseline = "middle";
  for (const { letter, to } of axesOf(frame, letters)) {
    x.fillStyle = css("--ink-3");
    const vertical = to[2] !== 0;
    // Up or down stands at the floor's left corner, clear of the body; the others at the floor's edge.
    const corner: Vector3 = [-EXTENT, EXTENT, FLOOR];
    const end: Vector3 = vertical ? [corner[0], corner[1], FLOOR + 0.34 * to[2]] : [to[0] * 1.38, to[1] * 1.38, FLOOR];
    if (vertical) {
      x.strokeStyle = css("--edge");
      line(x, at, corner, end);
    }
    const [px, py] = at(end);
    x.fillText(letter, px, vertical ? py - 8 * to[2] : py);
  }
}

function polygon(x: CanvasRenderingContext2D, points: readonly Vector3[]): void {
  x.beginPath();
  for (const [px, py] of points) x.lineTo(px, py);
  x.closePath();
}

/** The shadow straight below, as one shape: every face is wound the same way, so that overlaps do not darken or cancel. */
function drawShadow(x: CanvasRenderingContext2D, at: Place, corners: readonly Vector3[]): void {
  x.beginPath();
  for (const face of FACES) {
    const points = face.map((k) => at([corners[k]?.[0] ?? 0, corners[k]?.[1] ?? 0, FLOOR]));
    const area = points.reduce((sum, p, i) => {
      const next = points[(i + 1) % points.length] ?? p;
      return sum + p[0] * next[1] - next[0] * p[1];
    }, 0);
    if (area < 0) points.reverse();
    points.forEach(([px, py], i) => (i ? x.lineTo(px, py) : x.moveTo(px, py)));
    x.closePath();
  }
  x.fillStyle = css("--ink");
  x.globalAlpha = 0.07;
  x.fill("nonzero");
  x.globalAlpha = 1;
}

function drawBox(x: CanvasRenderingContext2D, at: Place, corners: readonly Vector3[]): void {
  const faces = FACES.map((face) => face.map((k) => at(corners[k] ?? [0, 0, 0])));
  const depth = (face: readonly Vector3[]): number => face.reduce((sum, p) => sum + p[2], 0);
  faces.sort((a, b) => depth(b) - depth(a));
  for (const face of faces) {
    polygon(x, face);
    x.fillStyle = css("--bg-raised");
    x.globalAlpha = 0.9;
    x.fill();
    x.globalAlpha = 1;
    x.strokeStyle = css("--edge");
    x.lineWidth = 1;
    x.stroke();
  }
}

function drawArrow(x: CanvasRenderingContext2D, at: Place, letter: "x" | "y" | "z", tip: Vector3): void {
  const [from, to] = [at([0, 0, 0]), at(tip)];
  const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
  const beside = (length: number, turn: number): readonly [number, number] => [
    to[0] + length * Math.cos(angle + turn),
    to[1] + length * Math.sin(angle + turn),
  ];
  x.strokeStyle = x.fillStyle = css(`--axis-${letter}`);
  x.lineWidth = 2.25;
  line(x, at, [0, 0, 0], tip);
  x.beginPath();
  for (const [length, turn] of [
    [7, 0],
    [4.5, 2.2],
    [4.5, -2.2],
  ] as const)
    x.lineTo(...beside(length, turn));
  x.fill();
  font(x, 12, 700);
  x.textAlign = "center";
  x.textBaseline = "middle";
  x.fillText(letter, ...beside(16, 0));
}
