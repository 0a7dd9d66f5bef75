/**
 * The calibration coach of a live device: what to do now in big words, live progress, and the result.
 *
 * The server holds the calibration; this page asks how it stands, so that a reload or a second phone shows the same.
 */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect } from "preact/hooks";
import { Dialog } from "../../ui/dialog";
import { addressOf, type Outcome, type HttpProblem, request } from "../../ui/http";
import { Message } from "../../ui/message";
import { ProblemNote } from "../../ui/problem-note";
import { fullName } from "../../wire/device-name";
import type { AvailableCalibration, CalibrationReport, CalibrationState } from "../../wire/routes";
import type { DeviceInfo, DeviceJobs } from "../../wire/types";
import { ProgressBar, Drive, Positions, Rest, Sphere } from "./progress";
import { CalibrationResult } from "./result";
import { Write } from "./write";
import { TEXT } from "./texts";
import "./calibration.css";

const ASK_EVERY_MS = 350;
const FORMATS = ["yaml", "json", "csv", "c"] as const;

interface Props {
  readonly device: DeviceInfo;
  readonly jobs: DeviceJobs | undefined;
  readonly onClose: () => void;
}

type Kind = CalibrationReport["kind"];

export function CalibrationDialog({ device, jobs, onClose }: Props) {
  const state = useSignal<CalibrationState | undefined>(undefined);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  /** Whether the choice is shown although there is a result. */
  const chooses = useSignal(false);
  const path = { device: device.id };
  // biome-ignore lint/correctness/useExhaustiveDependencies: signals stay the same
  useEffect(() => {
    const cancel = new AbortController();
    let timer: ReturnType<typeof setTimeout> | undefined;
    const ask = async (): Promise<void> => {
      const outcome = await request("GET /api/devices/{device}/calibration", { path, signal: cancel.signal });
      if (cancel.signal.aborted) return;
      if (outcome.ok) state.value = outcome.value;
      else problem.value = outcome.problem;
      timer = setTimeout(() => void ask(), ASK_EVERY_MS);
    };
    void ask();
    return () => {
      clearTimeout(timer);
      cancel.abort();
    };
  }, [device.id]);
  const take = (outcome: Outcome<CalibrationState>): void => {
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) return;
    state.value = outcome.value;
    chooses.value = false;
  };
  const start = async (kind: Kind): Promise<void> =>
    take(await request("POST /api/devices/{device}/calibration", { path, body: { kind } }));
  const finish = async (): Promise<void> =>
    take(await request("POST /api/devices/{device}/calibration/finish", { path }));
  const stop = async (): Promise<void> => {
    const outcome = await request("DELETE /api/devices/{device}/calibration", { path });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok && state.value) state.value = { ...state.value, is_running: false, report: null };
  };
  const now = state.value;
  const report = chooses.value ? null : now?.report;
  return (
    <Dialog title={TEXT.titleOf(fullName(device))} wide onClose={onClose}>
      <div class="calibration">
        {problem.value && <ProblemNote problem={problem.value} />}
        {now === undefined ? (
          problem.value === undefined && <p>{TEXT.loading}</p>
        ) : !report ? (
          <Choice available={now.available} start={(kind) => void start(kind)} />
        ) : now.is_running ? (
          <Coach report={report} finish={() => void finish()} stop={() => void stop()} />
        ) : (
          <Ended
            report={report}
            device={device}
            write={now.write && <Write key={now.write.setting} device={device.id} write={now.write} jobs={jobs} />}
            again={() => void start(report.kind)}
            others={() => (chooses.value = true)}
          />
        )}
      </div>
    </Dialog>
  );
}

interface ChoiceProps {
  readonly available: readonly AvailableCalibration[];
  readonly start: (kind: Kind) => void;
}

function Choice({ available, start }: ChoiceProps) {
  return (
    <>
      <p class="mid">{TEXT.choose}</p>
      <ul class="calibration-kinds">
        {available.map(({ kind, title, problem, hint }) => (
          <li key={kind}>
            <button type="button" class="btn edge" disabled={problem !== ""} onClick={() => start(kind)}>
              <b>{title}</b>
              <span>{TEXT.kinds[kind]}</span>
            </button>
            {problem !== "" && (
              <p class="dim">
                <Message text={`${problem} ${hint}`} />
              </p>
            )}
          </li>
        ))}
      </ul>
    </>
  );
}

interface CoachProps {
  readonly report: CalibrationReport;
  readonly finish: () => void;
  readonly stop: () => void;
}

function Coach({ report, finish, stop }: CoachProps) {
  const { refusal } = report;
  return (
    <>
      <h3>{TEXT.names[report.kind]}</h3>
      <p class="calibration-advice" aria-live="polite">
        {report.advice}
      </p>
      <ProgressBar label={TEXT.progress} share={report.progress} />
      {report.coverage && <Sphere coverage={report.coverage} />}
      {report.positions && <Positions positions={report.positions} />}
      {report.drive && <Drive drive={report.drive} />}
      {report.rest && <Rest rest={report.rest} />}
      <p class="calibration-refusal dim">
        {refusal && (
          <>
            {TEXT.notYet} <Message text={refusal.message} />
          </>
        )}
      </p>
      <div class="calibration-buttons">
        <button type="button" class="btn main" disabled={refusal !== null} onClick={finish}>
          {TEXT.finish}
        </button>
        <button type="button" class="btn edge" onClick={stop}>
          {TEXT.stop}
        </button>
      </div>
    </>
  );
}

interface EndedProps {
  readonly report: CalibrationReport;
  readonly device: DeviceInfo;
  readonly write: ComponentChildren;
  readonly again: () => void;
  readonly others: () => void;
}

function Ended({ report, device, write, again, others }: EndedProps) {
  const { correction, refusal } = report;
  return (
    <>
      <h3>{TEXT.names[report.kind]}</h3>
      {correction ? (
        <CalibrationResult report={report} correction={correction} />
      ) : (
        <div class="calibration-none">
          <b class="calibration-big">{TEXT.noResult}</b>
          {refusal && <ProblemNote problem={refusal} />}
        </div>
      )}
      {write}
      <div class="calibration-buttons">
        {correction && (
          <span class="calibration-export" role="group" aria-label={TEXT.export}>
            <span class="mid">{TEXT.export}</span>
            {FORMATS.map((format) => (
              <a
                key={format}
                class="btn edge"
                download
                href={addressOf("GET /api/devices/{device}/calibration/export", {
                  path: { device: device.id },
                  query: { format },
                })}
              >
                {TEXT.formats[format]}
              </a>
            ))}
          </span>
        )}
        <span class="grow" />
        <button type="button" class="btn edge" onClick={again}>
          {TEXT.again}
        </button>
        <button type="button" class="btn" onClick={others}>
          {TEXT.others}
        </button>
      </div>
    </>
  );
}
