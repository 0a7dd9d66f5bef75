/** The exports of a recording: running, done, failed. */
import { bytes } from "../../recordings/library-filter";
import { recordingsApi } from "../../recordings/api";
import { Button } from "../../ui/controls/button";
import { Icon } from "../../ui/controls/icons";
import { Message } from "../../ui/controls/message";
import type { ExportJob } from "../../wire/types";
import { run } from "../../page/app-state";
import type { App } from "../../page/context";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";
import "./export.css";

/** Exports of a recording: running, done, failed. */
export function Jobs({ app, recording }: { readonly app: App; readonly recording: string }) {
  const jobs = app.store.exports.value.filter((job) => job.recording === recording);
  if (jobs.length === 0) return null;
  return (
    <ul class="jobs" aria-label={TEXT.exports}>
      {[...jobs].reverse().map((job) => (
        <JobRow key={job.id} app={app} job={job} />
      ))}
    </ul>
  );
}

function JobRow({ app, job }: { readonly app: App; readonly job: ExportJob }) {
  const size = bytes(job.size);
  const going = job.state === "waiting" || job.state === "running";
  const words = {
    waiting: TEXT.exportState.waiting,
    running: `${Math.round(100 * job.progress)} %`,
    done: `${size.value} ${size.unit}`,
    failed: TEXT.exportState.failed,
    cancelled: TEXT.exportState.cancelled,
  }[job.state];
  return (
    <li>
      <span class="ellipsis">{job.title}</span>
      <span class="num" role="status">
        {job.state === "failed" && <span class="dot bad" />} {words}
      </span>
      {job.state === "done" ? (
        <a class="btn edge" href={recordingsApi.exportUrl(job.id)} download={job.file}>
          <Icon name="download" />
          {COMMON.download}
        </a>
      ) : (
        <Button
          changes
          look="edge"
          words={going ? COMMON.cancel : TEXT.removeFromList}
          onClick={() => void run(app, recordingsApi.cancelExport(job.id))}
        />
      )}
      {going && <progress value={job.progress} max={1} aria-label={`${job.title}: ${words}`} />}
      {job.message !== "" && (
        <span class="why mid">
          <Message text={job.message} /> <Message text={job.hint} />
        </span>
      )}
    </li>
  );
}
