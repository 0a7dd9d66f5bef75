/** The guided procedure for a device that answers at no rate: the user power-cycles it while the server calls it. */
import { Button } from "../../ui/controls/button";
import { isOver, JobLine, jobOf } from "./jobs";
import type { Model } from "./model";
import { configureApi } from "./api";
import { TEXT } from "../../texts/configure";

export function Restore({ model }: { readonly model: Model }) {
  const id = model.restoring.value;
  const job = id === undefined ? undefined : jobOf(model, id);
  const at = job === undefined ? 0 : isOver(job) ? (job.state === "done" ? 3 : 0) : 1;
  const start = async (): Promise<void> => {
    const made = await model.run(configureApi.restore(model.id));
    if (made === undefined) return;
    model.restoring.value = made.id;
    model.applied.value = undefined; // what failed before is over with it
  };
  const step = (k: number) => (at === k ? { "aria-current": "step" as const } : {});
  return (
    <div class="restore">
      <ol>
        <li {...step(0)}>
          <b>{TEXT.startStep}</b> {TEXT.restoreCalls}{" "}
          {at !== 1 && (
            <Button
              changes
              look="small main"
              words={job ? TEXT.startAgain : TEXT.startRestore}
              onClick={() => void start()}
            />
          )}
        </li>
        <li {...step(1)}>
          <b>{TEXT.powerCycleStep}</b> {TEXT.powerCycleReason}
        </li>
        <li {...step(3)}>
          <b>{TEXT.deviceRepliesStep}</b> {TEXT.restoreResult}
        </li>
      </ol>
      {id !== undefined && <JobLine model={model} id={id} />}
    </div>
  );
}
