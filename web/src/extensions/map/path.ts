/** The track of a window as points on a local metric grid, thinned to the picture's resolution; gaps in the samples are breaks. */
import { lowerBound } from "../../data/line-breaks";
import type { Channel } from "../../data/channels";
import type { CursorReading } from "../../data/cursor-time";
import { metresFrom } from "../../attitude/projection";
import { isPlace, type Position, qualityOf, facetWords } from "./position";
import type { GridPoint, TrackPoint } from "./track";

interface Path {
  readonly points: readonly (TrackPoint | undefined)[];
  readonly here: GridPoint | undefined;
  /** The origin of the grid; undefined before the first position. */
  readonly origin: readonly [lat: number, lon: number] | undefined;
}

/** Grid origin of each track: the first position drawn, so that nothing moves when the window does. */
const origins = new WeakMap<Channel, readonly [lat: number, lon: number]>();

/** The path within the window of `at`, of at most `most` points; `i` is the sample at the reading position. */
export function pathOf(position: Position, at: CursorReading, i: number, most: number): Path {
  const { ring } = position.channel;
  const { base } = at;
  const [first, last] = [Math.max(0, ring.indexAt(at.from, base)), ring.indexAt(at.to, base)];
  const pointAt = (k: number): GridPoint | undefined => {
    const [lat, lon] = [ring.value(position.lat, k), ring.value(position.lon, k)];
    if (!isPlace(lat, lon)) return undefined;
    const origin = origins.get(position.channel);
    if (origin === undefined) origins.set(position.channel, [lat, lon]);
    return metresFrom(origin ?? [lat, lon], lat, lon);
  };
  const points: (TrackPoint | undefined)[] = [];
  const step = Math.max(1, Math.ceil((last - first + 1) / most));
  let before = -1;
  // Counted from the stream's beginning, so that the same samples are drawn while the window moves.
  for (let k = first + ((step - ((ring.first + first) % step)) % step); k <= last; k += step) {
    const broken =
      before >= 0 && (ring.breaks[lowerBound(ring.breaks, ring.first + before + 1)] ?? Infinity) <= ring.first + k;
    if (broken) points.push(undefined);
    before = k;
    const where = pointAt(k);
    const quality = qualityOf(facetWords(position, position.fix, k), facetWords(position, position.carrier, k));
    points.push(where && { at: where, quality });
  }
  return { points, here: i < 0 ? undefined : pointAt(i), origin: origins.get(position.channel) };
}
