/** Writing a result to the device: an ordinary change of its settings, with its warning, job and snapshot. */
import { useSignal } from "@preact/signals";
import { Button } from "../../ui/controls/button";
import { type HttpProblem, request } from "../../requests/http";
import { Message } from "../../ui/controls/message";
import { ProblemNote } from "../../requests/problem-note";
import type { CalibrationWrite } from "../../wire/routes";
import type { DeviceJobs, Job } from "../../wire/types";
import { TEXT } from "./texts";

interface Props {
  readonly device: string;
  readonly write: CalibrationWrite;
  readonly jobs: DeviceJobs | undefined;
}

export function Write({ device, write, jobs }: Props) {
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
