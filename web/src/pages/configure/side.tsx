/** The right side: what extensions show of the device, and the queue of its jobs. */
import { Slot } from "../../extension/extension";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";
import type { App } from "../../page/context";
import { StopJob } from "./jobs";
import type { Model } from "./model";

declare module "../../extension/extension" {
  interface Slots {
    /** On the right of Configure; without a model there is no device. */
    readonly configureSide: { readonly app: App; readonly model: Model | undefined };
  }
}

export function ConfigureSide({ app, model }: { readonly app: App; readonly model: Model | undefined }) {
  return (
    <aside class={`side ${app.sheet.value === "side" ? "open" : ""}`} id="side" aria-label={COMMON.trafficLog}>
      <Slot name="configureSide" with={{ app, model }} />
      {model && <Queue model={model} />}
    </aside>
  );
}

/** Running and waiting jobs. */
function Queue({ model }: { readonly model: Model }) {
  const jobs = model.jobs.value;
  const waiting = jobs?.queue ?? [];
  const running = jobs?.running;
  return (
    <div class="queue">
      {running && (
        <p>
          <span class="dot live" />
          <span class="grow ellipsis">
            {running.title}
            {running.step ? `: ${running.step}` : ""}
          </span>
          <StopJob model={model} job={running} />
        </p>
      )}
      {waiting.map((job) => (
        <p key={job.id}>
          <span class="dot off" />
          <span class="grow ellipsis">{job.title}</span>
          <StopJob model={model} job={job} />
        </p>
      ))}
      {!running && waiting.length === 0 && (
        <p>
          <span class="dot off" />
          {TEXT.queueEmpty}
        </p>
      )}
    </div>
  );
}
