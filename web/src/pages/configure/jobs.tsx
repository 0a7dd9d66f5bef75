/** Jobs: what is being done to the device, what waits, what came of it. */
import type { ControlState, FieldOutcome, Job } from "../../wire/types";
import { Message } from "../../ui/message";
import { words } from "../../ui/labels";
import type { Model } from "./model";
import { server } from "./api";

/** A job of that number, wherever it is by now. */
export const jobOf = (model: Model, id: number): Job | undefined => jobIn(model.control.value, id);

export function jobIn(control: ControlState | undefined, id: number): Job | undefined {
  if (control === undefined) return undefined;
  const running = control.running ? [control.running] : [];
  return [...running, ...control.queue, ...control.done].find((job) => job.id === id);
}

export const isOver = (job: Job): boolean => job.state === "done" || job.state === "failed" || job.state === "stopped";

/** How a job goes: waiting, its step, its end with what the device refused or altered. */
export function JobLine({ model, id }: { readonly model: Model; readonly id: number }) {
  const job = jobOf(model, id);
  if (job === undefined) return null;
  return (
    <div class={`jobline ${job.state}`} role="status">
      <p>
        <span class={`dot ${job.state === "failed" ? "bad" : isOver(job) ? "live" : "off"}`} />
        <b>{job.title}</b> <span class="mid"><Message text={stateWords(job)} /></span>
        {!isOver(job) && <StopJob model={model} job={job} />}
      </p>
      {job.hint !== "" && <p class="dim"><Message text={job.hint} /></p>}
      <Outcomes outcomes={job.outcomes} />
      <Answer values={job.values} />
    </div>
  );
}

/** How a job goes, in words. */
export function stateWords(job: Job): string {
  if (job.state === "waiting") return "waits for its turn";
  if (job.state === "running") return job.step || "under way";
  return job.message || (job.state === "stopped" ? "Stopped." : "Done.");
}

export function StopJob({ model, job }: { readonly model: Model; readonly job: Job }) {
  return (
    <button type="button" class="btn small edge" onClick={() => void model.run(server.stop(model.id, job.id))}>
      {job.state === "waiting" ? "Take out" : "Stop"}
    </button>
  );
}

/** What the device did not take as asked. */
export function Outcomes({ outcomes }: { readonly outcomes: readonly FieldOutcome[] }) {
  if (outcomes.length === 0) return null;
  return (
    <ul class="outcomes" aria-label="Not as asked">
      {outcomes.map((one) => (
        <li key={`${one.setting} ${one.path}`}>
          <span class={`tag ${one.got ? "warn" : "bad"}`}>{one.got ? "▲ altered" : "■ refused"}</span> <b>{one.title}</b>{" "}
          {one.got ? `asked ${one.asked || "nothing"}, the device has ${one.got}` : <Message text={one.why || "no answer"} />}
        </li>
      ))}
    </ul>
  );
}

/** What a command answered. */
function Answer({ values }: { readonly values: Job["values"] }) {
  const entries = Object.entries(values);
  if (entries.length === 0) return null;
  return (
    <dl class="answer">
      {entries.map(([name, value]) => (
        <div key={name}>
          <dt>{words(name)}</dt>
          <dd class="mono">{typeof value === "object" ? JSON.stringify(value) : String(value)}</dd>
        </div>
      ))}
    </dl>
  );
}
