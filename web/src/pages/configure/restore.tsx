/** The guided procedure for a device that answers at no rate: a person switches its power while the server calls it. */
import { isOver, JobLine, jobOf } from "./jobs";
import { type Model, viewOnly } from "./model";
import { server } from "./api";

export function Restore({ model }: { readonly model: Model }) {
  const id = model.restoring.value;
  const job = id === undefined ? undefined : jobOf(model, id);
  const at = job === undefined ? 0 : isOver(job) ? (job.state === "done" ? 3 : 0) : 1;
  const start = async (): Promise<void> => {
    const made = await model.run(server.restore(model.id));
    if (made === undefined) return;
    model.restoring.value = made.id;
    model.applied.value = undefined; // what failed before is over with it
  };
  const step = (k: number) => (at === k ? { "aria-current": "step" as const } : {});
  return (
    <div class="restore">
      <ol>
        <li {...step(0)}>
          <b>Begin.</b> The server calls the device over and over, in the way its document gives for a lost line.{" "}
          {at !== 1 && (
            <button type="button" class="btn small main" disabled={viewOnly.value} onClick={() => void start()}>
              {job ? "Begin again" : "Begin"}
            </button>
          )}
        </li>
        <li {...step(1)}>
          <b>Switch the device's power off, wait two seconds, and on again.</b> It hears the call only while it starts.
        </li>
        <li {...step(3)}>
          <b>It answers</b> with the communication settings of the factory, and gets its old settings back.
        </li>
      </ol>
      {id !== undefined && <JobLine model={model} id={id} />}
    </div>
  );
}
