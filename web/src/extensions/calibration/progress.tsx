/** Live progress of a calibration: the sphere of directions, stillness, six positions, the drive. */
import { number } from "../../ui/format/format";
import type { DirectionCoverage, DriveProgress, RestProgress, SixPositions } from "../../wire/routes";
import { TEXT } from "./texts";

const RADIUS_PX = 90;
const HALF_PX = 112;

export function Sphere({ coverage }: { readonly coverage: DirectionCoverage }) {
  const paths = cellPaths(coverage.rings, RADIUS_PX);
  const place = screenPlaceOf(coverage.now);
  const words = TEXT.coverage(number(100 * coverage.share, 0));
  return (
    <figure class="calibration-sphere">
      <div class="calibration-halves" role="img" aria-label={words}>
        {TEXT.axes.poles.map((name, half) => (
          <svg key={name} viewBox={`${-HALF_PX} ${-HALF_PX} ${2 * HALF_PX} ${2 * HALF_PX}`} aria-hidden="true">
            {paths.map((path, k) => (
              <path key={path} class={coverage.seen[half * paths.length + k] ? "seen" : ""} d={path} />
            ))}
            <text x={RADIUS_PX + 12} y={4}>
              {TEXT.axes.right}
            </text>
            <text x={-RADIUS_PX - 12} y={4}>
              {TEXT.axes.left}
            </text>
            <text y={-RADIUS_PX - 7}>{TEXT.axes.top}</text>
            <text y={RADIUS_PX + 17}>{TEXT.axes.bottom}</text>
            <text class="pole" x={0} y={4}>
              {name}
            </text>
            {place?.half === half && <circle cx={place.x * RADIUS_PX} cy={-place.y * RADIUS_PX} r={10} />}
          </svg>
        ))}
      </div>
      <figcaption>
        {words} <span class="dim">{TEXT.present}</span>
      </figcaption>
    </figure>
  );
}

export function Rest({ rest }: { readonly rest: RestProgress }) {
  const still = Math.max(0, Math.min(1, 1 - rest.motion / 2));
  return (
    <div class={`calibration-rest stacked ${rest.is_still ? "is-still" : ""}`}>
      <b class="calibration-big" role="status">
        {rest.is_still ? TEXT.still : TEXT.moving}
      </b>
      <ProgressBar label={TEXT.stillness} share={still} />
      <span class="calibration-seconds">
        {TEXT.rested(number(Math.min(rest.seconds, rest.goal), 0), number(rest.goal, 0))}
      </span>
    </div>
  );
}

export function Positions({ positions }: { readonly positions: SixPositions }) {
  return (
    <ul class="calibration-positions" aria-label={TEXT.positions}>
      {positions.positions.map((one) => {
        const share = Math.min(1, one.seconds / positions.seconds);
        const isNow = positions.now === one.up;
        return (
          <li key={one.up} class={`${one.is_done ? "is-done" : ""} ${isNow ? "is-now" : ""}`}>
            <svg viewBox="0 0 64 64" aria-hidden="true">
              <rect x="10" y="14" width="44" height="44" rx="4" />
              <rect class="fill" x="10" y={58 - 44 * share} width="44" height={44 * share} rx="4" />
              <path d="M32 50V22M24 30l8-8 8 8" />
            </svg>
            <b>{TEXT.up(one.up)}</b>
            <span>{one.is_done ? TEXT.isDone : isNow ? TEXT.isNow : ""}</span>
          </li>
        );
      })}
    </ul>
  );
}

export function Drive({ drive }: { readonly drive: DriveProgress }) {
  const rows = [
    {
      name: TEXT.rest,
      share: drive.rest_s / drive.rest_needed_s,
      words: TEXT.of(number(drive.rest_s, 0), number(drive.rest_needed_s, 0), "s"),
    },
    {
      name: TEXT.speedChange,
      share: drive.speed_change / drive.speed_needed,
      words: TEXT.of(number(drive.speed_change, 1), number(drive.speed_needed, 1), "m/s"),
    },
    {
      name: TEXT.turned,
      share: drive.turn / drive.turn_allowed,
      words: TEXT.atMost(number(drive.turn, 1), number(drive.turn_allowed, 0)),
    },
  ];
  return (
    <ul class="calibration-drive stacked" aria-label={TEXT.drive}>
      {rows.map(({ name, share, words }) => (
        <li key={name}>
          <span>{name}</span>
          <ProgressBar label={name} share={share} />
          <span>{words}</span>
        </li>
      ))}
    </ul>
  );
}

export function ProgressBar({ label, share }: { readonly label: string; readonly share: number }) {
  const percent = Math.round(100 * Math.max(0, Math.min(1, share)));
  return (
    <div
      class="calibration-bar"
      role="progressbar"
      aria-label={label}
      aria-valuemin={0}
      aria-valuemax={100}
      aria-valuenow={percent}
    >
      <i style={{ width: `${percent}%` }} />
    </div>
  );
}

/*
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
