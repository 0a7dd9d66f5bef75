/** The difference of a clock to the time axis over the length of the file, with its steps; or the steps alone. */
import type { FileClock } from "../../wire/routes";
import { shortDuration } from "./duration";
import { TEXT } from "./texts";

type Difference = NonNullable<FileClock["difference"]>;

const [WIDTH, HEIGHT] = [1000, 60];
/** Usual distances between parts with samples; a longer one is left blank. */
const BLANK = 2.5;

interface Props {
  readonly name: string;
  /** Steps, unix s. */
  readonly marks: readonly number[];
  readonly start: number;
  readonly end: number;
}

const placeOf =
  ({ start, end }: Props) =>
  (time: number): number =>
    (WIDTH * (time - start)) / Math.max(end - start, 1e-9);

function Marks({ places, height }: { readonly places: readonly number[]; readonly height: number }) {
  return (
    <>
      {places.map((x, i) => (
        <path key={`${i} ${x}`} class="file-time-step" d={["M", x.toFixed(1), " 0v", height].join("")} />
      ))}
    </>
  );
}

export function DifferenceStrip(props: Props) {
  const { name, marks } = props;
  return (
    <svg
      class="file-time-strip"
      role="img"
      aria-label={TEXT.steps(name)}
      viewBox={`0 0 ${WIDTH} 12`}
      preserveAspectRatio="none"
    >
      <line x1="0" x2={WIDTH} y1="6" y2="6" />
      <Marks places={marks.map(placeOf(props))} height={12} />
    </svg>
  );
}

export function DifferencePlot(props: Props & { readonly of: Difference }) {
  const { name, of, marks } = props;
  const [low, high] = [Math.min(0, ...of.low), Math.max(0, ...of.high)];
  const x = placeOf(props);
  const y = (value: number): number => HEIGHT - (HEIGHT * (value - low)) / Math.max(high - low, 1e-12);
  const label = TEXT.difference(name, signedDuration(low), signedDuration(high));
  return (
    <figure class="file-time-difference">
      <figcaption>{label}</figcaption>
      <svg
        role="img"
        aria-label={TEXT.differenceOver(name, signedDuration(low), signedDuration(high))}
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        preserveAspectRatio="none"
      >
        <line x1="0" x2={WIDTH} y1={y(0)} y2={y(0)} />
        {runsOf(of).map((run) => (
          <path key={run[0]} class="file-time-band" d={bandOf(run, of, x, y)} />
        ))}
        <Marks places={marks.map(x)} height={HEIGHT} />
      </svg>
    </figure>
  );
}

const signedDuration = (seconds: number): string => `${seconds < 0 ? "−" : "+"}${shortDuration(seconds)}`;

/** Places of neighbouring parts with samples; a step of the difference ends a run. */
function runsOf({ times, edges }: Difference): readonly (readonly number[])[] {
  const distances = times.slice(1).map((time, i) => time - (times[i] ?? time));
  const usual = distances.sort((a, b) => a - b)[distances.length >> 1] ?? 0;
  const runs: number[][] = [];
  times.forEach((time, i) => {
    const before = times[i - 1] ?? -Infinity;
    const isApart = time - before > BLANK * usual || edges.some((edge) => edge > before && edge <= time);
    if (isApart || runs.length === 0) runs.push([]);
    runs.at(-1)?.push(i);
  });
  return runs;
}

function bandOf(
  run: readonly number[],
  { times, low, high }: Difference,
  x: (time: number) => number,
  y: (value: number) => number,
): string {
  const point = (i: number, values: readonly number[]): string =>
    `${x(times[i] ?? 0).toFixed(1)} ${y(values[i] ?? 0).toFixed(1)}`;
  const there = run.map((i) => point(i, high));
  const back = [...run].reverse().map((i) => point(i, low));
  return `M${[...there, ...back].join("L")}Z`;
}
