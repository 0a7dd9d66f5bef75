/**
 * The calibration coach of a live device: what to do now in big words, live progress, and the result.
 *
 * The server holds the calibration; this page asks how it stands, so that a reload or a second phone shows the same.
 */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { Button } from "../../ui/controls/button";
import { Dialog } from "../../ui/controls/dialog";
import { addressOf, type Outcome, request, type HttpProblem } from "../../requests/http";
import { Message } from "../../ui/controls/message";
import { ProblemNote } from "../../requests/problem-note";
import { Answered, useAnswer } from "../../requests/use-answer";
import { fullName } from "../../wire/device-name";
import type { AvailableCalibration, CalibrationReport, CalibrationState, CalibrationWrite } from "../../wire/routes";
import type { DeviceInfo, DeviceJobs, Job } from "../../wire/types";
import { ProgressBar, Drive, Positions, Rest, Sphere } from "./progress";
import { CalibrationResult } from "./result";
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
  /** Whether the choice is shown although there is a result. */
  const chooses = useSignal(false);
  const path = { device: device.id };
  const ask = () => request("GET /api/devices/{device}/calibration", { path });
  const asked = useAnswer<CalibrationState>(device.id, ask, { everyMs: ASK_EVERY_MS });
  const { send } = asked;
  const take = async (change: Promise<Outcome<CalibrationState>>): Promise<void> => {
    if (await send(change)) chooses.value = false;
  };
  const start = (kind: Kind): Promise<void> =>
    take(request("POST /api/devices/{device}/calibration", { path, body: { kind } }));
  const finish = (): Promise<void> => take(request("POST /api/devices/{device}/calibration/finish", { path }));
  const ended = async (): Promise<Outcome<CalibrationState>> => {
    const outcome = await request("DELETE /api/devices/{device}/calibration", { path });
    const available = asked.answer?.available ?? [];
    return outcome.ok ? { ok: true, value: { available, is_running: false, report: null, write: null } } : outcome;
  };
  const stop = (): Promise<boolean> => send(ended());
  const view = (now: CalibrationState) => {
    const report = chooses.value ? null : now.report;
    if (!report) return <Choice available={now.available} start={(kind) => void start(kind)} />;
    if (now.is_running) return <Coach report={report} finish={() => void finish()} stop={() => void stop()} />;
    return (
      <Ended
        report={report}
        device={device}
        write={now.write && <Write key={now.write.setting} device={device.id} write={now.write} jobs={jobs} />}
        again={() => void start(report.kind)}
        others={() => (chooses.value = true)}
      />
    );
  };
  return (
    <Dialog title={TEXT.titleOf(fullName(device))} wide onClose={onClose}>
      <div class="calibration">
        <Answered of={asked} waiting={<p>{TEXT.loading}</p>}>
          {view}
        </Answered>
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
            <Button changes look="edge" disabled={problem !== ""} onClick={() => start(kind)}>
              <b>{title}</b>
              <span>{TEXT.kinds[kind]}</span>
            </Button>
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
      <div class="calibration-buttons control-row">
        <Button changes look="main" words={TEXT.finish} disabled={refusal !== null} onClick={finish} />
        <Button changes look="edge" words={TEXT.stop} onClick={stop} />
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
      <div class="calibration-buttons control-row">
        {correction && (
          <span class="calibration-export control-row" role="group" aria-label={TEXT.export}>
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
        <Button changes look="edge" words={TEXT.again} onClick={again} />
        <Button changes words={TEXT.others} onClick={others} />
      </div>
    </>
  );
}

interface WriteProps {
  readonly device: string;
  readonly write: CalibrationWrite;
  readonly jobs: DeviceJobs | undefined;
}

function Write({ device, write, jobs }: WriteProps) {
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const job = useSignal<{ readonly id: number; readonly isWrite: boolean } | undefined>(undefined);
  const path = { device };
  const { setting, values } = write;
  const send = async (confirmed: boolean): Promise<void> => {
    problem.value = undefined;
    const outcome = values
      ? await request("POST /api/devices/{device}/apply", {
          path,
          body: { changes: { [setting]: values }, reason: TEXT.names["mounting"] ?? "", confirmed },
        })
      : await request("POST /api/devices/{device}/read", { path, body: { confirmed } });
    if (outcome.ok) job.value = { id: outcome.value.id, isWrite: values !== null };
    else problem.value = outcome.problem;
  };
  const asks = problem.value?.kind === "confirm";
  const running = jobWith(jobs, job.value?.id);
  const isBusy = running !== undefined && (running.state === "waiting" || running.state === "running");
  return (
    <section class="calibration-write" aria-label={TEXT.write}>
      <p>
        {TEXT.writes(write.title)} <Message text={values ? write.note : `${write.problem} ${write.hint}`} />
      </p>
      {problem.value && <ProblemNote problem={asks ? { ...problem.value, hint: "" } : problem.value} />}
      <div class="calibration-buttons control-row">
        {asks ? (
          <>
            <Button changes look="edge" words={TEXT.proceed} onClick={() => void send(true)} />
            <Button words={TEXT.cancel} onClick={() => (problem.value = undefined)} />
          </>
        ) : (
          <Button
            changes
            look="main"
            words={values ? TEXT.write : TEXT.readFirst}
            disabled={isBusy}
            onClick={() => void send(false)}
          />
        )}
      </div>
      {running && (
        <p role="status">
          <b>{running.title}</b> <Message text={running.message || running.step || TEXT.waiting} />{" "}
          {running.state === "done" && job.value?.isWrite && TEXT.written}
        </p>
      )}
    </section>
  );
}

function jobWith(jobs: DeviceJobs | undefined, id: number | undefined): Job | undefined {
  if (jobs === undefined || id === undefined) return undefined;
  return [...(jobs.running ? [jobs.running] : []), ...jobs.queue, ...jobs.done].find((job) => job.id === id);
}
