import { describe, expect, it } from "vitest";
import { eulerOfMatrix, type Matrix3, matrixOfEuler, type Vector3 } from "../data/rotations";
import { nedFromEcef, geodeticOf, product } from "./ecef";

const transpose = (m: Matrix3): Matrix3 => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];

/** The position of a place, by the definition of the ellipsoid. */
function ecefOf(lat: number, lon: number, height: number): Vector3 {
  const [p, l, e2] = [(lat * Math.PI) / 180, (lon * Math.PI) / 180, 0.0066943799901413165];
  const n = 6_378_137 / Math.sqrt(1 - e2 * Math.sin(p) ** 2);
  return [
    (n + height) * Math.cos(p) * Math.cos(l),
    (n + height) * Math.cos(p) * Math.sin(l),
    (n * (1 - e2) + height) * Math.sin(p),
  ];
}

describe("placeOf", () => {
  it("finds the place of a position, anywhere on the ground", () => {
    for (const [lat, lon, height] of [
      [52.22, 6.89, 71],
      [-33.9, 151.2, 5],
      [0, 0, 0],
      [89.9, -120, 4000],
      [-41, 179.99, 12000],
    ] as const) {
      const place = geodeticOf(ecefOf(lat, lon, height));
      expect(place?.[0]).toBeCloseTo(lat, 6);
      expect(place?.[1]).toBeCloseTo(lon, 9);
    }
    expect(geodeticOf([0, 0, 0])).toBeUndefined();
    expect(geodeticOf([NaN, 0, 0])).toBeUndefined();
  });
});

describe("nedFromEcef", () => {
  it("has down towards the earth, and east along the parallel", () => {
    const m = nedFromEcef([0, 0]); // at Greenwich on the equator
    expect(m.map((v) => Math.round(v) + 0)).toEqual([0, 0, 1, 0, 1, 0, -1, 0, 0]);
  });
  it("gives back the attitude that was turned into the earth's axes", () => {
    const [attitude, place] = [matrixOfEuler([5, -12, 123]), [52.22, 6.89] as const];
    const earth = product(transpose(nedFromEcef(place)), attitude);
    const [roll, pitch, yaw] = eulerOfMatrix(product(nedFromEcef(place), earth));
    expect([roll, pitch, yaw].map((v) => Math.round(1e9 * v) / 1e9)).toEqual([5, -12, 123]);
  });
});
