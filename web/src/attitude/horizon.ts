/** The artificial horizon, drawn like the pilot's instrument: it shows the world, not a sign convention. */
import { css, font, type Surface } from "../ui/dom/canvas";
import { number } from "../ui/format/format";
import type { Horizon } from "./projection";

const DEGREE = Math.PI / 180;
/** Pitch from the centre to the rim, in °. */
const PITCH_RANGE_DEG = 24;
/** The ladder ends before the bank scale at the rim, in °. */
const LADDER = 17;
const BANK_TICKS = [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60];

/** Draws `horizon`; undefined draws the empty instrument. */
export function drawHorizon(to: Surface, horizon: Horizon | undefined): void {
  if (!to.begin()) return;
  const x = to.context;
  const radius = Math.min(to.width(), to.height()) / 2 - 1;
  x.save();
  x.translate(to.width() / 2, to.height() / 2);
  x.beginPath();
  x.arc(0, 0, radius, 0, 7);
  x.fillStyle = css("--bg-raised");
  x.fill();
  if (horizon) {
    x.save();
    x.clip();
    x.rotate(-horizon.bank * DEGREE);
    drawWorld(x, radius, horizon.nose);
    x.restore();
    drawBank(x, radius, horizon.bank);
  }
  drawAircraft(x, radius);
  x.beginPath();
  x.arc(0, 0, radius, 0, 7);
  x.strokeStyle = css("--line-strong");
  x.lineWidth = 1;
  x.stroke();
  x.restore();
}

/** Sky, ground and the pitch ladder, in the world's orientation; the ladder counts ° of the nose above the horizon. */
function drawWorld(x: CanvasRenderingContext2D, radius: number, nose: number): void {
  const scale = radius / PITCH_RANGE_DEG;
  x.save();
  x.translate(0, nose * scale);
  const far = radius + 90 * scale;
  const sky = x.createLinearGradient(0, -radius, 0, 0);
  sky.addColorStop(0, css("--sky-2"));
  sky.addColorStop(1, css("--sky"));
  x.fillStyle = sky;
  x.fillRect(-2 * radius, -far, 4 * radius, far);
  const ground = x.createLinearGradient(0, 0, 0, radius);
  ground.addColorStop(0, css("--ground"));
  ground.addColorStop(1, css("--ground-2"));
  x.fillStyle = ground;
  x.fillRect(-2 * radius, 0, 4 * radius, far);
  x.strokeStyle = x.fillStyle = css("--horizon");
  x.lineWidth = 1.5;
  x.beginPath();
  x.moveTo(-2 * radius, 0);
  x.lineTo(2 * radius, 0);
  x.stroke();
  x.lineWidth = 1;
  font(x, 10);
  x.textBaseline = "middle";
  const first = Math.max(-90, Math.ceil((nose - LADDER) / 5) * 5);
  const last = Math.min(90, nose + LADDER);
  for (let degrees = first; degrees <= last; degrees += 5) {
    if (degrees === 0) continue;
    const major = degrees % 10 === 0;
    const half = radius * (major ? 0.27 : 0.13);
    const y = -degrees * scale;
    x.globalAlpha = major ? 0.85 : 0.55;
    x.beginPath();
    x.moveTo(-half, y);
    x.lineTo(half, y);
    x.stroke();
    if (!major) continue;
    x.textAlign = "right";
    x.fillText(number(degrees, 0), -half - 5, y);
    x.textAlign = "left";
    x.fillText(number(degrees, 0), half + 5, y);
  }
  x.restore();
}

/** The fixed bank scale at the rim and the pointer that stays with the sky. */
function drawBank(x: CanvasRenderingContext2D, radius: number, bank: number): void {
  x.strokeStyle = x.fillStyle = css("--horizon");
  x.globalAlpha = 0.8;
  for (const degrees of BANK_TICKS) {
    const major = degrees % 30 === 0;
    x.save();
    x.rotate(degrees * DEGREE);
    x.lineWidth = major ? 1.75 : 1;
    x.beginPath();
    x.moveTo(0, -radius);
    x.lineTo(0, -radius + (major ? 10 : 6));
    x.stroke();
    x.restore();
  }
  x.globalAlpha = 1;
  x.save();
  x.rotate(-bank * DEGREE);
  x.beginPath();
  x.moveTo(0, -radius + 11);
  x.lineTo(-5.5, -radius + 20);
  x.lineTo(5.5, -radius + 20);
  x.fill();
  x.restore();
}

/** The fixed mark of the sensor itself: its x axis points into the picture. */
function drawAircraft(x: CanvasRenderingContext2D, radius: number): void {
  x.lineCap = x.lineJoin = "round";
  for (const [colour, width, alpha] of [
    [css("--bg"), 6, 0.5],
    [css("--ink"), 2.6, 1],
  ] as const) {
    x.strokeStyle = colour;
    x.lineWidth = width;
    x.globalAlpha = alpha;
    x.beginPath();
    for (const side of [-1, 1]) {
      x.moveTo(side * radius * 0.5, 0);
      x.lineTo(side * radius * 0.2, 0);
      x.lineTo(side * radius * 0.2, 6);
    }
    x.moveTo(-1, 0);
    x.lineTo(1, 0);
    x.stroke();
  }
  x.globalAlpha = 1;
}
