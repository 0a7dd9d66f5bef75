/** Jobs of the device: running, waiting, finished. */
import type { DeviceJobs, FieldOutcome, Job } from "../../wire/types";
import { Button } from "../../ui/controls/button";
import { Message } from "../../ui/controls/message";
import { labelWords } from "../../ui/format/labels";
import type { Model } from "./model";
import { configureApi } from "./api";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";

/** A job by number, in any state. */
export const jobOf = (model: Model, id: number): Job | undefined => jobIn(model.jobs.value, id);

export function jobIn(jobs: DeviceJobs | undefined, id: number): Job | undefined {
  if (jobs === undefined) return undefined;
  const running = jobs.running ? [jobs.running] : [];
  return [...running, ...jobs.queue, ...jobs.done].find((job) => job.id === id);
}

export const isOver = (job: Job): boolean => job.state === "done" || job.state === "failed" || job.state === "stopped";

/** Progress of a job: waiting, its step, its end with refused or altered values. */
export function JobLine({ model, id }: { readonly model: Model; readonly id: number }) {
  const job = jobOf(model, id);
  if (job === undefined) return null;
  return (
    <div class={`job-line ${job.state}`} role="status">
      <p>
        <span class={`dot ${job.state === "failed" ? "bad" : isOver(job) ? "live" : "off"}`} />
        <b>{job.title}</b>{" "}
        <span class="mid">
          <Message text={stateWords(job)} />
        </span>
        {!isOver(job) && <StopJob model={model} job={job} />}
      </p>
      {job.hint !== "" && (
        <p class="dim">
          <Message text={job.hint} />
        </p>
      )}
      <Outcomes outcomes={job.outcomes} />
      <Answer values={job.values} />
    </div>
  );
}

export function stateWords(job: Job): string {
  if (job.state === "waiting") return TEXT.queued;
  if (job.state === "running") return job.step || TEXT.running;
  return job.message || (job.state === "stopped" ? TEXT.stopped : TEXT.done);
}

export function StopJob({ model, job }: { readonly model: Model; readonly job: Job }) {
  if (job.state === "running" && model.jobs.value?.pending_rollback?.state === "pending") return null; // the banner asks
  return (
    <Button
      changes
      look="small edge"
      words={job.state === "waiting" ? TEXT.removeFromQueue : COMMON.stop}
      onClick={() => void model.run(configureApi.stop(model.id, job.id))}
    />
  );
}

/** Values that the device did not accept as requested. */
export function Outcomes({ outcomes }: { readonly outcomes: readonly FieldOutcome[] }) {
  if (outcomes.length === 0) return null;
  return (
    <ul class="outcomes text-sm" aria-label={TEXT.differences}>
      {outcomes.map((one) => (
        <li key={`${one.setting} ${one.path}`}>
          <span class={`tag ${one.actual ? "warn" : "bad"}`}>{one.actual ? TEXT.alteredMark : TEXT.rejectedMark}</span>{" "}
          <b>{one.title}</b>{" "}
          {one.actual ? (
            TEXT.alteredValue(one.requested || TEXT.nothing, one.actual)
          ) : (
            <Message text={one.reason || TEXT.noAnswer} />
          )}
        </li>
      ))}
    </ul>
  );
}

/** Answer of a command. */
function Answer({ values }: { readonly values: Job["values"] }) {
  const entries = Object.entries(values);
  if (entries.length === 0) return null;
  return (
    <dl class="answer">
      {entries.map(([name, value]) => (
        <div key={name}>
          <dt>{labelWords(name)}</dt>
          <dd class="mono">{typeof value === "object" ? JSON.stringify(value) : String(value)}</dd>
        </div>
      ))}
    </dl>
  );
}
