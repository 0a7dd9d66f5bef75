/**
 * Local level at a place on the earth, for devices that give attitude or position against the earth's own axes (ECEF: x through
 * Greenwich at the equator, z through the pole), which do not define up without a place.
 *
 * Source: WGS 84; latitude from ECEF after Bowring (1985), good to a millionth of a degree near the surface.
 */
import type { Matrix3, Vector3 } from "../data/rotations";

const A = 6_378_137;
const F = 1 / 298.257223563;
const E2 = F * (2 - F);
const B = A * (1 - F);
const RADIAN = Math.PI / 180;

/** Latitude and longitude, °, of a position in metres; undefined if invalid (a receiver without a fix sends zeros). */
export function geodeticOf([x, y, z]: Vector3): readonly [lat: number, lon: number] | undefined {
  const p = Math.hypot(x, y);
  if (!(Math.hypot(p, z) > 1e6)) return undefined;
  const beta = Math.atan2(z * A, p * B);
  const lat = Math.atan2(z + ((A * A - B * B) / B) * Math.sin(beta) ** 3, p - E2 * A * Math.cos(beta) ** 3);
  return [lat / RADIAN, Math.atan2(y, x) / RADIAN];
}

/** North, east and down at a place as rows in the earth's axes: v_NED = R v_ECEF. */
export function nedFromEcef([lat, lon]: readonly [lat: number, lon: number]): Matrix3 {
  const [sp, cp] = [Math.sin(lat * RADIAN), Math.cos(lat * RADIAN)];
  const [sl, cl] = [Math.sin(lon * RADIAN), Math.cos(lon * RADIAN)];
  return [-sp * cl, -sp * sl, cp, -sl, cl, 0, -cp * cl, -cp * sl, -sp];
}

/** a b, of matrices row by row. */
export function product(a: Matrix3, b: Matrix3): Matrix3 {
  const at = (r: 0 | 1 | 2, c: 0 | 1 | 2): number =>
    a[(3 * r) as 0] * b[c] + a[(3 * r + 1) as 1] * b[(3 + c) as 3] + a[(3 * r + 2) as 2] * b[(6 + c) as 6];
  return [at(0, 0), at(0, 1), at(0, 2), at(1, 0), at(1, 1), at(1, 2), at(2, 0), at(2, 1), at(2, 2)];
}
