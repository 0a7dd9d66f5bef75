/**
 * Geometry of a rotation for the horizon, the turning body and the heading. Pure.
 *
 * A rotation is `R`, frame from body: column j of R is body axis j written in the frame's axes (frames and conversions:
 * data/rotations.ts, data/frames.ts). Everything drawn is the world itself, computed in one frame (ENU), so the horizon does not
 * move when the user chooses another frame. In ENU and NWU positive pitch is nose down, in NED nose up; the display says which.
 *
 * Body axes go with the frame: level is z up in ENU and NWU, z down in NED.
 */
import { type Matrix3, type Vector3, type WorldFrame, vectorIn } from "../data/rotations";
import { TEXT } from "../texts/attitude";

export const FRAMES: readonly WorldFrame[] = ["ENU", "NED", "NWU"];
const DEGREE = Math.PI / 180;

/** m v. */
export function apply(m: Matrix3, v: Vector3): Vector3 {
  return [
    m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
    m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
    m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
  ];
}

/** Values of the horizon, in °: nose above the horizon is positive `nose`, right side down is positive `bank`. */
export interface Horizon {
  readonly nose: number;
  readonly bank: number;
}

/** The horizon of a rotation written in ENU whose body axes are those of `native`. */
export function horizonOf(enu: Matrix3, native: WorldFrame): Horizon {
  const upright = native === "NED" ? -1 : 1;
  return {
    nose: Math.asin(Math.max(-1, Math.min(1, enu[6]))) / DEGREE,
    bank: Math.atan2(upright * enu[7], upright * enu[8]) / DEGREE,
  };
}

/** Direction of body x over ground, ° clockwise from north in [0, 360); undefined while x points up or down. */
export function headingOf(enu: Matrix3): number | undefined {
  const [east, north] = [enu[0], enu[3]];
  if (Math.hypot(east, north) < 1e-3) return undefined;
  const degrees = Math.atan2(east, north) / DEGREE;
  return degrees < 0 ? degrees + 360 : degrees;
}

/** Meaning of a positive pitch numeral in a frame. */
export function pitchSign(frame: WorldFrame): string {
  return frame === "NED" ? TEXT.noseUp : TEXT.noseDown;
}

/** The frame's axes as directions of the world (ENU), with their letters. */
export function axesOf(
  frame: WorldFrame,
  letters: string = frame,
): readonly { readonly letter: string; readonly to: Vector3 }[] {
  const units: readonly Vector3[] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  return units.map((unit, i) => ({ letter: letters.charAt(i), to: vectorIn(unit, frame, "ENU") }));
}

/** Position of a camera: turned by `azimuth` about up, raised by `elevation`, both in radians. */
export interface Camera {
  readonly azimuth: number;
  readonly elevation: number;
}

/** A point of the world on the picture: right, up, and how far behind it lies (for sorting). */
export function project(camera: Camera, p: Vector3): Vector3 {
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
