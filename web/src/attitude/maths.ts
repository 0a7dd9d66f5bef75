/**
 * How is a rotation seen? Pure geometry behind the horizon, the turning body and the heading.
 *
 * A rotation is `R`, frame from body: column j of R is body axis j written in the frame's axes. The frames differ only in
 * how they name the same three directions of the world:
 *
 *     ENU   x east    y north   z up
 *     NED   x north   y east    z down
 *     NWU   x north   y west    z up
 *
 * Everything drawn is the world itself, so it is worked out in one frame (ENU) and does not move when a person asks for
 * another frame's numbers. In ENU and NWU positive pitch is nose down, in NED nose up; the horizon shows which it is.
 *
 * Body axes are the sensor's own. "Upright" is what the frame the device speaks calls level: z up for a device that sends ENU
 * or NWU, z down for one that sends NED.
 */

export type Frame = "ENU" | "NED" | "NWU";
export const FRAMES: readonly Frame[] = ["ENU", "NED", "NWU"];

/** 3 × 3, row by row: m[3 * row + column]. */
export type Matrix = readonly [number, number, number, number, number, number, number, number, number];
export type Vector = readonly [number, number, number];

export const IDENTITY: Matrix = [1, 0, 0, 0, 1, 0, 0, 0, 1];
const DEGREE = Math.PI / 180;

export function apply(m: Matrix, v: Vector): Vector {
  return [
    m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
    m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
    m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
  ];
}

/** Frame from body, of the unit quaternion w, x, y, z (scaled to unit length; undefined when it has none). */
export function matrixOfQuaternion(w: number, x: number, y: number, z: number): Matrix | undefined {
  const n = w * w + x * x + y * y + z * z;
  if (!(n > 1e-12) || !Number.isFinite(n)) return undefined;
  const s = 2 / n;
  return [
    1 - s * (y * y + z * z),
    s * (x * y - w * z),
    s * (x * z + w * y),
    s * (x * y + w * z),
    1 - s * (x * x + z * z),
    s * (y * z - w * x),
    s * (x * z - w * y),
    s * (y * z + w * x),
    1 - s * (x * x + y * y),
  ];
}

/** Frame from body, of roll, pitch and yaw in ° (about x, y, z; turned in the order yaw, pitch, roll: ZYX intrinsic). */
export function matrixOfEuler(roll: number, pitch: number, yaw: number): Matrix | undefined {
  if (!Number.isFinite(roll + pitch + yaw)) return undefined;
  const [cr, sr] = [Math.cos(roll * DEGREE), Math.sin(roll * DEGREE)];
  const [cp, sp] = [Math.cos(pitch * DEGREE), Math.sin(pitch * DEGREE)];
  const [cy, sy] = [Math.cos(yaw * DEGREE), Math.sin(yaw * DEGREE)];
  return [
    cy * cp,
    cy * sp * sr - sy * cr,
    cy * sp * cr + sy * sr,
    sy * cp,
    sy * sp * sr + cy * cr,
    sy * sp * cr - cy * sr,
    -sp,
    cp * sr,
    cp * cr,
  ];
}

/** The same rotation with its rows written in ENU. */
export function inEnu(m: Matrix, frame: Frame): Matrix {
  const [a, b, c, d, e, f, g, h, i] = m;
  if (frame === "NED") return [d, e, f, a, b, c, -g, -h, -i];
  if (frame === "NWU") return [-d, -e, -f, a, b, c, g, h, i];
  return m;
}

/** What the horizon shows, in °: nose above the horizon is positive `nose`, right side down is positive `bank`. */
export interface Horizon {
  readonly nose: number;
  readonly bank: number;
}

/** The horizon of a device that speaks `native`, from its rotation written in ENU. */
export function horizonOf(enu: Matrix, native: Frame): Horizon {
  const upright = native === "NED" ? -1 : 1;
  return {
    nose: Math.asin(Math.max(-1, Math.min(1, enu[6]))) / DEGREE,
    bank: Math.atan2(upright * enu[7], upright * enu[8]) / DEGREE,
  };
}

/** Direction of body x over ground, ° clockwise from north in [0, 360); undefined while x points up or down. */
export function headingOf(enu: Matrix): number | undefined {
  const [east, north] = [enu[0], enu[3]];
  if (Math.hypot(east, north) < 1e-3) return undefined;
  const degrees = Math.atan2(east, north) / DEGREE;
  return degrees < 0 ? degrees + 360 : degrees;
}

/** What a positive pitch numeral means in a frame. */
export function pitchSign(frame: Frame): string {
  return frame === "NED" ? "+ nose up" : "+ nose down";
}

/** The frame's axes as directions of the world (ENU), with the letter each is known by. */
export function axesOf(frame: Frame): readonly { readonly letter: string; readonly to: Vector }[] {
  const [north, east] = [
    { letter: "N", to: [0, 1, 0] as Vector },
    { letter: "E", to: [1, 0, 0] as Vector },
  ];
  if (frame === "NED") return [north, east, { letter: "D", to: [0, 0, -1] }];
  if (frame === "NWU") return [north, { letter: "W", to: [-1, 0, 0] }, { letter: "U", to: [0, 0, 1] }];
  return [east, north, { letter: "U", to: [0, 0, 1] }];
}

/** Where a camera stands: turned by `azimuth` about up, raised by `elevation`, both in radians. */
export interface Camera {
  readonly azimuth: number;
  readonly elevation: number;
}

/** A point of the world on the picture: right, up, and how far behind it lies (for sorting). */
export function project(camera: Camera, p: Vector): Vector {
  const [ca, sa] = [Math.cos(camera.azimuth), Math.sin(camera.azimuth)];
  const [ce, se] = [Math.cos(camera.elevation), Math.sin(camera.elevation)];
  const right = p[0] * ca - p[1] * sa;
  const away = p[0] * sa + p[1] * ca;
  return [right, away * se + p[2] * ce, away * ce - p[2] * se];
}

/** Metres east and north of `origin` (latitude, longitude in °); good to a part in a thousand over 10 km. */
export function metresFrom(origin: readonly [number, number], lat: number, lon: number): readonly [number, number] {
  const metresPerDegree = 111_319.49;
  const turn = ((lon - origin[1] + 540) % 360) - 180; // over the date line
  return [turn * metresPerDegree * Math.cos(origin[0] * DEGREE), (lat - origin[0]) * metresPerDegree];
}

/** A rotation whose rows are in ENU, written in `frame`: the inverse of `inEnu`, which is its own kind of swap. */
export function fromEnu(m: Matrix, frame: Frame): Matrix {
  const [a, b, c, d, e, f, g, h, i] = m;
  if (frame === "NED") return [d, e, f, a, b, c, -g, -h, -i];
  if (frame === "NWU") return [d, e, f, -a, -b, -c, g, h, i];
  return m;
}

/** Roll, pitch and yaw in ° of a rotation (ZYX intrinsic); at pitch ±90° roll is 0 and yaw takes the rest. */
export function eulerOf(m: Matrix): { readonly roll: number; readonly pitch: number; readonly yaw: number } {
  const pitch = Math.asin(Math.max(-1, Math.min(1, -m[6]))) / DEGREE;
  if (Math.abs(m[6]) > 1 - 1e-12) return { roll: 0, pitch, yaw: Math.atan2(-m[1], m[4]) / DEGREE };
  return { roll: Math.atan2(m[7], m[8]) / DEGREE, pitch, yaw: Math.atan2(m[3], m[0]) / DEGREE };
}
