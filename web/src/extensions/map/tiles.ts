/**
 * Map tiles under the track. A tile is 256 px of the world in Mercator's projection, cut into 2^z by 2^z; the track is in metres on a
 * plain grid about its first point. The corners of each tile are projected onto that grid, so track and map agree along the track.
 * Tiles come through our own port (server/api/map_tiles.py), a few at a time, and recent ones are cached.
 */
import { serverRoot } from "../../requests/server-place";
import { metresFrom } from "../../attitude/projection";
import type { GridPoint, TrackView } from "./track";

export const TILE_PX = 256;
/** Tile servers rarely go deeper; a closer view enlarges these. */
const MAX_ZOOM = 19;
const EQUATOR_M = 40_075_016.7;
/** More than a screen full, an upper limit for any picture. */
const MAX_TILES = 96;
const MAX_IMAGES = 256;
const AT_ONCE = 6;
const RADIAN = Math.PI / 180;
/** Mercator's square ends here. */
const MAX_LATITUDE_DEG = 85.0511;

export type Origin = readonly [lat: number, lon: number];

interface Placed {
  readonly z: number;
  readonly x: number;
  readonly y: number;
  /** Corners on the track's grid, m. */
  readonly northWest: GridPoint;
  readonly southEast: GridPoint;
}

/** The zoom at which a tile's pixels are closest to the picture's; `scale` in px a metre. */
export function zoomOf(scale: number, lat: number): number {
  const wanted = Math.log2((EQUATOR_M * Math.cos(lat * RADIAN) * scale) / TILE_PX);
  return Math.min(MAX_ZOOM, Math.max(0, Math.round(wanted)));
}

/** Column and row, not rounded, of a place at zoom `z`. */
export function tileAt(lat: number, lon: number, z: number): readonly [x: number, y: number] {
  const p = Math.min(MAX_LATITUDE_DEG, Math.max(-MAX_LATITUDE_DEG, lat)) * RADIAN;
  const n = 2 ** z;
  return [((lon + 180) / 360) * n, ((1 - Math.asinh(Math.tan(p)) / Math.PI) / 2) * n];
}

/** The place at a column and row: the inverse of `tileAt`. */
export function placeAt(x: number, y: number, z: number): Origin {
  const n = 2 ** z;
  return [Math.atan(Math.sinh(Math.PI * (1 - (2 * y) / n))) / RADIAN, (x / n) * 360 - 180];
}

/** The tiles under a picture of `w` by `h` px; none if there would be too many. */
export function tilesUnder(view: TrackView, origin: Origin, w: number, h: number): readonly Placed[] {
  const [reachE, reachN] = [w / 2 / view.scale, h / 2 / view.scale];
  const perDegree = metresFrom([0, 0], 1, 0)[1];
  const placeOf = (east: number, north: number): Origin => [
    origin[0] + north / perDegree,
    origin[1] + east / (perDegree * Math.cos(origin[0] * RADIAN)),
  ];
  const z = zoomOf(view.scale, origin[0]);
  const [left, top] = tileAt(...placeOf(view.middle[0] - reachE, view.middle[1] + reachN), z).map(Math.floor) as [
    number,
    number,
  ];
  const [right, bottom] = tileAt(...placeOf(view.middle[0] + reachE, view.middle[1] - reachN), z).map(Math.floor) as [
    number,
    number,
  ];
  const n = 2 ** z;
  if ((right - left + 1) * (bottom - top + 1) > MAX_TILES) return [];
  const found: Placed[] = [];
  for (let x = left; x <= right; x += 1) {
    for (let y = Math.max(0, top); y <= Math.min(n - 1, bottom); y += 1) {
      const corner = (dx: number, dy: number): GridPoint => metresFrom(origin, ...placeAt(x + dx, y + dy, z));
      found.push({ z, x: ((x % n) + n) % n, y, northWest: corner(0, 0), southEast: corner(1, 1) }); // round the world
    }
  }
  return found;
}

/** Cache of tile images. `changed` is called after each load. */
export class TileCache {
  readonly #images = new Map<string, HTMLImageElement>();
  readonly #waiting = new Set<string>();
  #loading = 0;
  /** Failed tiles since the last success. */
  failed = 0;

  constructor(readonly changed: () => void) {}

  /** The image of a tile; undefined while it is being loaded. */
  get({ z, x, y }: Placed): HTMLImageElement | undefined {
    const path = `/api/tiles/${z}/${x}/${y}`;
    const image = this.#images.get(path);
    if (image !== undefined) {
      this.#images.delete(path); // the most recently used is evicted last
      this.#images.set(path, image);
      return image.complete && image.naturalWidth > 0 ? image : undefined;
    }
    this.#waiting.add(path);
    return undefined;
  }

  /** Request missing tiles and drop unneeded requests. Call after each drawing. */
  fetch(): void {
    for (const path of this.#waiting) {
      if (this.#loading >= AT_ONCE) break;
      this.#waiting.delete(path);
      this.#load(path);
    }
    this.#waiting.clear();
  }

  #load(path: string): void {
    const image = new Image();
    this.#images.set(path, image);
    this.#loading += 1;
    const done = (good: boolean): void => {
      this.#loading -= 1;
      this.failed = good ? 0 : this.failed + 1;
      this.changed();
    };
    image.onload = () => done(true);
    image.onerror = () => done(false);
    image.src = serverRoot() + path;
    for (const old of this.#images.keys()) {
      if (this.#images.size <= MAX_IMAGES) break;
      this.#images.delete(old);
    }
  }
}
