/** What stands in a form's place, or above it, while there is none: reading, never read, lost, not permitted, no settings at all. */
import { isOver, JobLine, jobOf, StopJob } from "./jobs";
import { describe } from "../../forms/elsewhere";
import { type Model, viewOnly } from "./model";
import { linkTo, readAll, unfinishedOf } from "./view-state";
import { Message } from "../../ui/message";

export function NotRead({ model }: { readonly model: Model }) {
  const device = model.device.value;
  const last = model.control.value?.done[0];
  const failed = model.lastRead.value === undefined ? undefined : jobOf(model, model.lastRead.value);
  return (
    <div class="veil">
      <div class="card">
        <h2>
          <span class="dot off" />
          Not read yet
        </h2>
        <p>What {device?.name ?? "the device"} is set to is not known here. Ask it for all of its settings; they are kept as a snapshot.</p>
        {device?.protocol === "xbus" && <p class="hint">An MTi stops measuring while it is asked, for about a second.</p>}
        {failed && isOver(failed) && failed.state !== "done" && last?.id === failed.id && <JobLine model={model} id={failed.id} />}
        <div class="row">
          <button type="button" class="btn main" disabled={viewOnly.value} onClick={() => readAll(model)}>
            Read the settings
          </button>
        </div>
      </div>
    </div>
  );
}

export function Reading({ model }: { readonly model: Model }) {
  const job = model.control.value?.running;
  if (!job) return null;
  return (
    <div class="veil">
      <div class="card" role="status">
        <h2>
          <span class="dot live" />
          {job.title}
        </h2>
        <p>{job.step || "Asking the device …"}</p>
        <div class="row">
          <StopJob model={model} job={job} />
        </div>
      </div>
    </div>
  );
}

/** There is nothing to fill in: the protocol is not known, or has no settings, or the server does not say. */
export function NoForms({ model }: { readonly model: Model }) {
  const device = model.device.value;
  const problem = model.problem.value;
  return (
    <div class="veil">
      <div class="card">
        <h2>
          <span class={`dot ${problem ? "bad" : "off"}`} />
          {problem ? "No settings to show" : device?.protocol ? "Loading the forms" : "Not known yet"}
        </h2>
        <p>{problem ? <Message text={problem.message} /> : (device?.protocol ? "The forms of this device are on their way." : "Its protocol is not known yet: the forms follow from it.")}</p>
        {(problem?.hint || device?.message) && <p class="hint"><Message text={problem?.hint || device?.message || ""} /></p>}
        <div class="row">
          <button type="button" class="btn main" onClick={() => void model.load()}>
            Try again
          </button>
        </div>
      </div>
    </div>
  );
}

export function ViewOnlyBand() {
  if (!viewOnly.value) return null;
  return (
    <div class="band calm" role="status">
      <span class="dot off" />
      <b>View only</b>
      <span class="grow">This page was opened with a view token. Open it with a control token to change something.</span>
    </div>
  );
}

export function LostBand({ model }: { readonly model: Model }) {
  const device = model.device.value;
  if (!device || device.status === "live" || device.status === "idle") return null;
  if (model.control.value?.trial?.state === "unreachable") return null; // the deck says more
  return (
    <div class={`band ${device.status === "connecting" ? "calm" : ""}`} role="status">
      <span class={`dot ${device.status === "connecting" ? "off" : "bad"}`} />
      <b>{{ lost: "Lost", denied: "Not permitted", ended: "Ended", connecting: "Connecting" }[device.status]}</b>
      <span class="grow">
        <Message text={device.message} /> <Message text={device.hint} /> What is shown is as last read; edits stay until they can be written.
      </span>
      {device.status === "lost" && (model.forms.value?.settings.length ?? 0) > 0 && (
        <a class="btn small edge" href={linkTo(model, "restore")}>
          Restore communication
        </a>
      )}
    </div>
  );
}

/** What somebody else changed in the settings that are edited here; the edits stand on top of it. */
export function ElsewhereBand({ model }: { readonly model: Model }) {
  const found = model.elsewhere.value;
  const forms = model.forms.value;
  if (found.length === 0 || !forms) return null;
  return (
    <div class="band calm" role="status">
      <span class="dot warn" />
      <b>Changed elsewhere</b>
      <div class="grow">
        <ul>
          {found.map((one) => (
            <li key={`${one.setting} ${one.path.join(".")}`}>
              {describe(forms, one, model.present.value[one.setting])}
              {one.conflict && <b class="yourswords"> You edited this too: your value stays in the form.</b>}
            </li>
          ))}
        </ul>
        <span class="dim">Your edits are kept, based on what the device has now.</span>
      </div>
      <button type="button" class="btn small" onClick={() => (model.elsewhere.value = [])}>
        Dismiss
      </button>
    </div>
  );
}

/** A command began something that must be ended before anything else is done. */
export function UnfinishedBand({ model }: { readonly model: Model }) {
  const [words] = unfinishedOf(model);
  if (words === undefined) return null;
  return (
    <div class="band calm" role="status" data-key="unfinished">
      <span class="dot off" />
      <b>Not finished</b>
      <span class="grow">{words}</span>
    </div>
  );
}

export function ProblemLine({ model }: { readonly model: Model }) {
  const problem = model.problem.value;
  if (!problem || problem.kind === "view-only") return null;
  return (
    <div class="band" role="alert">
      <span class="dot bad" />
      <b><Message text={problem.message} /></b>
      <span class="grow"><Message text={problem.hint} /></span>
      <button type="button" class="btn small" onClick={() => (model.problem.value = undefined)}>
        Dismiss
      </button>
    </div>
  );
}
