/** The panel: which clock is the time axis and why, and all clocks of the file with their figures and steps. */
import { useSignal } from "@preact/signals";
import { render } from "preact";
import { useEffect } from "preact/hooks";
import type { FileClock, FileTime, MessageClocks } from "../../wire/routes";
import type { Deps } from "../../panels/panel-context";
import type { Panel } from "../../ui/dom";
import { clock as timeOfDay, rate as rateText, signed } from "../../ui/format";
import { type HttpProblem, request } from "../../ui/http";
import { ProblemNote } from "../../ui/problem-note";
import { shortDuration } from "./duration";
import { readingOf, withTimes } from "./reading";
import { reopen } from "./reopen";
import { TEXT } from "./texts";
import "./file-time.css";

type Step = FileClock["steps"][number];

/** Seconds shown around a step. */
const ROOM_S = 2;
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

export function mountClocks(host: HTMLElement, deps: Deps): Panel {
  render(<ClocksPanel deps={deps} />, host);
  return { update: () => undefined, dispose: () => render(null, host) };
}

function ClocksPanel({ deps }: { readonly deps: Deps }) {
  const file = useSignal<FileTime | undefined>(undefined);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const id = deps.recording?.id ?? "";
  useEffect(() => {
    const over = new AbortController();
    void request("GET /api/recordings/{recording}/clocks", { path: { recording: id }, signal: over.signal }).then(
      (outcome) => {
        if (over.signal.aborted) return;
        if (outcome.ok) file.value = outcome.value;
        else problem.value = outcome.problem;
      },
    );
    return () => over.abort();
  }, [id]);
  if (problem.value) return <ProblemNote problem={problem.value} />;
  const time = file.value;
  if (!time) return <p class="foot-note dim">{TEXT.loading}</p>;
  const sentences = time.sentences.length > 0 ? time.sentences : [TEXT.ofDevice];
  const use = async (clock: FileClock): Promise<void> => {
    const { reading, is_table } = time;
    const choice = clock.use === "arrival" ? ("arrival" as const) : ("" as const);
    const body = is_table ? withTimes(readingOf(reading), clock.use) : { ...reading, clock: choice };
    const outcome = await request("PUT /api/recordings/{recording}/reading", { path: { recording: id }, body });
    if (outcome.ok) reopen(id);
    else if (is_table) deps.open.dialog("file-time/reading", { ...time, reading: body });
    else problem.value = outcome.problem;
  };
  const automatic = async (): Promise<void> => {
    const outcome = await request("DELETE /api/recordings/{recording}/reading", { path: { recording: id } });
    if (outcome.ok) reopen(id);
    else problem.value = outcome.problem;
  };
  return (
    <div class="file-time">
      {sentences.map((sentence) => (
        <p key={sentence}>{sentence}</p>
      ))}
      {(time.is_table || time.is_chosen) && (
        <div class="file-time-choice">
          {time.is_chosen && <span class="dim">{TEXT.isChosen}</span>}
          {time.is_table && (
            <button
              type="button"
              class="btn small edge"
              title={TEXT.readOtherwiseHint}
              onClick={() => deps.open.dialog("file-time/reading", time)}
            >
              {TEXT.readOtherwise}
            </button>
          )}
          {time.is_chosen && (
            <button
              type="button"
              class="btn small edge"
              title={time.is_table ? TEXT.automaticHint : TEXT.automaticClock}
              onClick={() => void automatic()}
            >
              {TEXT.automatic}
            </button>
          )}
        </div>
      )}
      {time.messages.map((one) => (
        <Clocks
          key={`${one.device} ${one.message}`}
          of={one}
          file={time}
          deps={deps}
          onUse={(clock) => void use(clock)}
        />
      ))}
    </div>
  );
}

interface ClocksProps {
  readonly of: MessageClocks;
  readonly file: FileTime;
  readonly deps: Deps;
  readonly onUse: (clock: FileClock) => void;
}

function Clocks({ of, file, deps, onUse }: ClocksProps) {
  return (
    <section>
      <h4>{of.message}</h4>
      <div class="file-time-scroll">
        <table aria-label={TEXT.of(of.message)}>
          <thead>
            <tr>
              {HEADINGS.map(([text, hint]) => (
                <th key={text} title={hint}>
                  {text}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {of.clocks.map((one) => (
              <Row key={one.name} clock={one} onUse={onUse} />
            ))}
          </tbody>
        </table>
      </div>
      {of.clocks.map((one) => (
        <Steps key={one.name} clock={one} file={file} deps={deps} />
      ))}
    </section>
  );
}

function Row({ clock, onUse }: { readonly clock: FileClock; readonly onUse: ClocksProps["onUse"] }) {
  const { drift_ppm: drift, jitter_s: jitter, rate_hz: rate, resolution_s: resolution } = clock;
  return (
    <tr>
      <th scope="row">
        {clock.name}{" "}
        {clock.is_axis && (
          <span class="file-time-axis" title={TEXT.axisHint}>
            {TEXT.axis}
          </span>
        )}
        {!clock.is_axis && clock.use !== "" && (
          <button type="button" class="btn small edge" title={TEXT.useHint} onClick={() => onUse(clock)}>
            {TEXT.use}
          </button>
        )}
      </th>
      <td>{clock.unit}</td>
      <td>{clock.epoch}</td>
      <td>{rate ? `${rateText(rate)} Hz` : TEXT.none}</td>
      <td>{resolution ? shortDuration(resolution) : TEXT.none}</td>
      <td>{drift === null ? TEXT.none : `${signed(drift, 1)} ppm`}</td>
      <td>{jitter === null ? TEXT.none : shortDuration(jitter)}</td>
      <td>{clock.gaps}</td>
      <td>{clock.repeats}</td>
      <td>{`${Math.round(100 * clock.bursts)} %`}</td>
    </tr>
  );
}

function words({ kind, by_s: by }: Step): string {
  const size = shortDuration(by);
  return kind === "back" ? TEXT.back(size) : kind === "ahead" ? TEXT.ahead(size) : TEXT.wrap(size);
}

interface StepsProps {
  readonly clock: FileClock;
  readonly file: FileTime;
  readonly deps: Deps;
}

/** The steps of a clock: where they are in the file, and what each is. */
function Steps({ clock, file, deps }: StepsProps) {
  const { start, end } = file;
  if (clock.steps.length === 0 || start === null || end === null) return null;
  const length = Math.max(end - start, 1e-9);
  return (
    <>
      <svg
        class="file-time-strip"
        role="img"
        aria-label={TEXT.steps(clock.name)}
        viewBox="0 0 1000 12"
        preserveAspectRatio="none"
      >
        <line x1="0" x2="1000" y1="6" y2="6" />
        {clock.steps.map((step) => (
          <path key={step.row} d={`M${((1000 * (step.time - start)) / length).toFixed(1)} 0v12`} />
        ))}
      </svg>
      <ul>
        {clock.steps.map((step) => (
          <li key={step.row}>
            <button
              type="button"
              class="btn small"
              title={TEXT.show}
              onClick={() => deps.jump?.({ t0: step.time - ROOM_S, t1: step.time + ROOM_S })}
            >
              {timeOfDay(step.time, 3)}
            </button>{" "}
            {clock.name} {words(step)} <span class="dim">{TEXT.atSample(step.row)}</span>
          </li>
        ))}
      </ul>
      {clock.steps_in_all > clock.steps.length && <p class="dim">{TEXT.more(clock.steps_in_all)}</p>}
    </>
  );
}
