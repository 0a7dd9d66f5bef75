/**
 * Directions around a sensor as two discs, one for the half around +z and one for the half around −z, in an equal-area projection.
 *
 * Azimuth runs from +x at the right over +y at the top in both, so the discs look as if the sphere were seen through from above. The cells
 * are those of the server (DirectionCoverage): rings of sectors of equal area.
 */

interface Place {
  readonly half: 0 | 1;
  /** In a disc of radius 1, y upwards. */
  readonly x: number;
  readonly y: number;
}

/** Outlines of all cells of a half as paths in a disc of radius `size`, y downwards. */
export function cellPaths(rings: readonly number[], size: number): readonly string[] {
  const total = rings.reduce((sum, count) => sum + count, 0);
  const paths: string[] = [];
  let before = 0;
  for (const count of rings) {
    const [inner, outer] = [before, before + count].map((cells) => size * Math.sqrt(cells / total)) as [number, number];
    for (let k = 0; k < count; k += 1) paths.push(sector(inner, outer, k / count, (k + 1) / count));
    before += count;
  }
  return paths;
}

function sector(inner: number, outer: number, from: number, to: number): string {
  const at = (radius: number, turn: number): string =>
    `${(radius * Math.cos(2 * Math.PI * turn)).toFixed(2)} ${(-radius * Math.sin(2 * Math.PI * turn)).toFixed(2)}`;
  const start = `M${at(inner, from)}L${at(outer, from)}`;
  const arc = `A${outer} ${outer} 0 0 0 ${at(outer, to)}`;
  const back = inner === 0 ? "L0 0" : `L${at(inner, to)}A${inner} ${inner} 0 0 1 ${at(inner, from)}`;
  return `${start}${arc}${back}Z`;
}

/** The place of a direction; undefined without one. */
export function screenPlaceOf(direction: readonly number[]): Place | undefined {
  const [x, y, z] = direction;
  if (x === undefined || y === undefined || z === undefined) return undefined;
  const flat = Math.hypot(x, y);
  const radius = Math.sqrt(Math.max(0, 1 - Math.abs(z)));
  const scale = flat === 0 ? 0 : radius / flat;
  return { half: z >= 0 ? 0 : 1, x: x * scale, y: y * scale };
}
