import { describe, expect, it } from "vitest";
import { placeAt, tileAt, TILE_PX, tilesUnder, zoomOf } from "./tiles";

const ORIGIN = [52.22, 6.89] as const;

describe("tiles", () => {
  it("are those of the usual scheme", () => {
    expect(tileAt(0, 0, 1)).toEqual([1, 1]);
    expect(tileAt(85.0511, -180, 3).map((v) => Math.round(1000 * v) / 1000)).toEqual([0, 0]);
    // 51.5074 N, 0.1278 W at zoom 10, by the formula of the OpenStreetMap wiki ("Slippy map tilenames").
    expect(tileAt(51.5074, -0.1278, 10).map(Math.floor)).toEqual([511, 340]);
  });

  it("map back to their position", () => {
    const [x, y] = tileAt(...ORIGIN, 15);
    const [lat, lon] = placeAt(x, y, 15);
    expect(lat).toBeCloseTo(ORIGIN[0], 9);
    expect(lon).toBeCloseTo(ORIGIN[1], 9);
  });

  it("are drawn at about their native size", () => {
    const placed = tilesUnder({ middle: [0, 0], scale: 1 }, ORIGIN, 800, 600);
    const width = placed[0]!.southEast[0] - placed[0]!.northWest[0];
    expect(width).toBeGreaterThan(TILE_PX / Math.SQRT2);
    expect(width).toBeLessThan(TILE_PX * Math.SQRT2);
  });

  it("cover the picture without holes", () => {
    const placed = tilesUnder({ middle: [120, -340], scale: 0.7 }, ORIGIN, 800, 600);
    const reach = [400 / 0.7, 300 / 0.7] as const;
    expect(Math.min(...placed.map(({ northWest }) => northWest[0]))).toBeLessThanOrEqual(120 - reach[0]);
    expect(Math.max(...placed.map(({ southEast }) => southEast[0]))).toBeGreaterThanOrEqual(120 + reach[0]);
    expect(Math.max(...placed.map(({ northWest }) => northWest[1]))).toBeGreaterThanOrEqual(-340 + reach[1]);
    expect(Math.min(...placed.map(({ southEast }) => southEast[1]))).toBeLessThanOrEqual(-340 - reach[1]);
    expect(new Set(placed.map(({ x, y }) => `${x} ${y}`)).size).toBe(placed.length);
  });

  it("are few at every zoom", () => {
    for (const scale of [1e-4, 1e-3, 0.1, 1, 100, 1e4]) {
      const placed = tilesUnder({ middle: [0, 0], scale }, ORIGIN, 1600, 1000);
      expect(placed.length).toBeLessThanOrEqual(96);
      expect(placed.every(({ z, x, y }) => x >= 0 && y >= 0 && x < 2 ** z && y < 2 ** z)).toBe(true);
    }
    expect(zoomOf(1e4, 52)).toBe(19);
  });
});
