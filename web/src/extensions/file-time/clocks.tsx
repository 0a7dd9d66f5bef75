/** All clocks of a message with their figures and steps, drawn over the length of the file or of the memory of a stream. */
import { TableHead } from "../../ui/controls/table-head";
import type { Deps } from "../../page/context";
import { Button } from "../../ui/controls/button";
import { number, rate as rateText, signed, clock as timeOfDay } from "../../ui/format/format";
import type { FileClock, FileTime, MessageClocks } from "../../wire/routes";
import { shortDuration } from "./duration";
import { TEXT } from "./texts";
import "./file-time.css";

type Step = FileClock["steps"][number];

/** Of the file, or of the memory of a stream: unix s. */
export type TimeSpan = Pick<FileTime, "start" | "end">;

/** Seconds shown around a step. */
const ROOM_S = 2;
/** Steps that are listed at once; more are behind a line. */
const OPEN = 3;
const HEADINGS = [
  [TEXT.clock, undefined],
  [TEXT.unit, undefined],
  [TEXT.zero, undefined],
  [TEXT.rate, undefined],
  [TEXT.resolution, undefined],
  [TEXT.drift, TEXT.driftHint],
  [TEXT.jitter, TEXT.jitterHint],
  [TEXT.gaps, TEXT.gapsHint],
  [TEXT.repeats, TEXT.repeatsHint],
  [TEXT.bursts, TEXT.burstsHint],
] as const;

interface ClocksProps {
  readonly of: MessageClocks;
  readonly span: TimeSpan;
  readonly jump: Deps["jump"];
  /** Makes a clock the time axis; without it, none can be chosen. */
  readonly onUse?: (clock: FileClock) => void;
}

/** The clocks of a message: a table of figures, then the difference and the steps of each. */
export function Clocks({ of, span, jump, onUse }: ClocksProps) {
  return (
    <section>
      <h4>{of.message}</h4>
      <div class="file-time-scroll">
        <table aria-label={TEXT.of(of.message)}>
          <TableHead of={HEADINGS.map(([text, title]) => ({ text, title }))} />
          <tbody>
            {of.clocks.map((one, i) => (
              <Row key={`${i} ${one.name}`} clock={one} onUse={onUse} />
            ))}
          </tbody>
        </table>
      </div>
      {of.clocks.map((one, i) => (
        <Course key={`${i} ${one.name}`} clock={one} span={span} jump={jump} />
      ))}
    </section>
  );
}

interface RowProps {
  readonly clock: FileClock;
  readonly onUse: ClocksProps["onUse"];
}

function Row({ clock, onUse }: RowProps) {
  const { jitter_s: jitter, rate_hz: rate, resolution_s: resolution } = clock;
  return (
    <tr>
      <th scope="row">
        {clock.name}{" "}
        {clock.is_axis && (
          <span class="file-time-axis" title={TEXT.axisHint}>
            {TEXT.axis}
          </span>
        )}
        {onUse && !clock.is_axis && clock.use !== "" && (
          <Button changes look="small edge" words={TEXT.use} title={TEXT.useHint} onClick={() => onUse(clock)} />
        )}
      </th>
      <td>{clock.unit}</td>
      <td>{clock.epoch}</td>
      <td>{rate ? `${rateText(rate)} Hz` : TEXT.none}</td>
      <td>{resolution ? shortDuration(resolution) : TEXT.none}</td>
      <td>{driftWords(clock)}</td>
      <td>{jitter === null ? TEXT.none : shortDuration(jitter)}</td>
      <td>{clock.gaps}</td>
      <td>{clock.repeats}</td>
      <td>{burstWords(clock)}</td>
    </tr>
  );
}

function driftWords({ drift_ppm: drift, drift_error_ppm: error }: FileClock): string {
  if (drift === null) return TEXT.none;
  if (typeof error !== "number") return `${signed(drift, 1)} ppm`;
  const digits = error < 10 ? 1 : 0;
  return `${signed(drift, digits)} ±${number(error, digits)} ppm`;
}

/** Share of samples in bursts, and how many a burst has. */
function burstWords({ bursts, burst_samples: samples }: FileClock): string {
  const share = Math.round(100 * bursts);
  return share > 0 && samples > 0 ? TEXT.burstsOf(share, Number(samples.toPrecision(2))) : `${share} %`;
}

function words({ kind, by_s: by }: Step): string {
  const size = shortDuration(by);
  if (kind === "back") return TEXT.back(size);
  if (kind === "restart") return TEXT.restart(size);
  return kind === "ahead" ? TEXT.ahead(size) : TEXT.wrap(size);
}

interface CourseProps {
  readonly clock: FileClock;
  readonly span: TimeSpan;
  readonly jump: Deps["jump"];
}

/** A clock over the length of the file: its difference to the axis, where its steps are, and what each is. */
function Course({ clock, span: { start, end }, jump }: CourseProps) {
  if (start === null || end === null) return null;
  const { difference, steps } = clock;
  const marks = steps.map(({ time }) => time);
  return (
    <>
      {difference ? (
        <DifferencePlot name={clock.name} of={difference} marks={marks} start={start} end={end} />
      ) : (
        steps.length > 0 && <DifferenceStrip name={clock.name} marks={marks} start={start} end={end} />
      )}
      {steps.length > OPEN ? (
        <details>
          <summary>{TEXT.stepsOf(clock.name, clock.steps_in_all)}</summary>
          <StepList clock={clock} jump={jump} />
        </details>
      ) : (
        steps.length > 0 && <StepList clock={clock} jump={jump} />
      )}
      {steps.length <= OPEN && clock.steps_in_all > steps.length && <p class="dim">{TEXT.more(clock.steps_in_all)}</p>}
    </>
  );
}

function StepList({ clock, jump }: Pick<CourseProps, "clock" | "jump">) {
  return (
    <ul>
      {clock.steps.map((step) => (
        <li key={step.row}>
          <Button
            look="small"
            words={timeOfDay(step.time, 3)}
            title={TEXT.show}
            onClick={() => jump?.({ t0: step.time - ROOM_S, t1: step.time + ROOM_S })}
          />{" "}
          {clock.name} {words(step)} <span class="dim no-wrap">{TEXT.atSample(step.row)}</span>
        </li>
      ))}
    </ul>
  );
}

type Difference = NonNullable<FileClock["difference"]>;

const [WIDTH, HEIGHT] = [1000, 60];
/** Usual distances between parts with samples; a longer one is left blank. */
const BLANK_STEPS = 2.5;

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

function DifferenceStrip(props: Props) {
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

function DifferencePlot(props: Props & { readonly of: Difference }) {
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
    const isApart = time - before > BLANK_STEPS * usual || edges.some((edge) => edge > before && edge <= time);
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
