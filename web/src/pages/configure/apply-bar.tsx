/** The bar at the foot: pending changes, why they cannot be written, progress and result. */
import { useEffect, useRef } from "preact/hooks";
import { capacityAt } from "../../forms/budget";
import { number } from "../../ui/format/format";
import type { LoadInfo } from "../../wire/form-types";
import type { Job } from "../../wire/types";
import { Button } from "../../ui/controls/button";
import { IconButton } from "../../ui/controls/icon-button";
import { Message } from "../../ui/controls/message";
import { isOver, JobLine, jobOf, StopJob } from "./jobs";
import type { Model } from "./model";
import { configureApi } from "./api";
import { isViewOnly } from "../../wire/capabilities";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";

export function ApplyBar({ model }: { readonly model: Model }) {
  const changes = model.changes.value;
  const names = Object.keys(changes);
  const last = model.applied.value;
  const job = last === undefined ? undefined : jobOf(model, last);
  const running = model.jobs.value?.running;
  // rejected values are shown first; the changes are still there behind them
  if (job && (!isOver(job) || names.length === 0 || !tookAll(job))) return <Progress model={model} id={job.id} />;
  if (names.length === 0) {
    return running ? (
      <div class="apply-bar" role="region" aria-label={TEXT.progress}>
        <span class="dot off" />
        <span class="grow ellipsis" role="status">
          <b>{running.title}</b> <span class="mid">{running.step}</span>
        </span>
        <StopJob model={model} job={running} />
      </div>
    ) : null;
  }
  return <Changes model={model} names={names} />;
}

function Changes({ model, names }: { readonly model: Model; readonly names: readonly string[] }) {
  const total = names.reduce((sum, name) => sum + (model.counts.value.get(name) ?? 1), 0);
  const titles = names.map((name) => model.setting(name)?.title ?? name);
  const blocked = model.blocked.value;
  const line = names.map((name) => model.previews.value[name]).find((preview) => preview?.line);
  return (
    <div class="apply-bar" role="region" aria-label={TEXT.changesToWrite}>
      <div class="grow">
        <p>
          <b class="edited-words">{TEXT.changeCount(total)}</b>{" "}
          <span class="mid">
            {TEXT.inTitles(titles.slice(0, 3).join(", "))}
            {titles.length > 3 ? TEXT.andMore(titles.length - 3) : ""}
          </span>
        </p>
        <p class={blocked ? "why-not" : "dim"} id="apply-why">
          <Message text={blocked || (line ? TEXT.temporaryChange : TEXT.snapshotBeforeWrite)} />{" "}
          <Share of={line?.load ?? null} baud={model.baud.value} />
        </p>
      </div>
      <label class="field reason">
        <span class="visually-hidden">{TEXT.reasonLabel}</span>
        <input
          type="text"
          placeholder={TEXT.reasonPlaceholder}
          value={model.reason.value}
          onInput={(event) => (model.reason.value = event.currentTarget.value)}
        />
      </label>
      <IconButton icon="undo" label={TEXT.undoLastEdit} title={TEXT.undoHint} onClick={() => model.undo()} />
      <Button look="edge" words={TEXT.discardAll} onClick={() => model.discard()} />
      <Button
        look="main"
        words={COMMON.apply}
        disabled={blocked !== ""}
        aria-describedby="apply-why"
        onClick={() => void apply(model, names)}
      />
    </div>
  );
}

/** Load of the link after the change; its bar stands below the fields of the form, perhaps out of sight. */
function Share({ of: load, baud }: { readonly of: LoadInfo | null; readonly baud: number | undefined }) {
  const capacity = load && capacityAt(load, baud);
  const rate = baud ?? load?.baud;
  if (!load || !capacity || !rate) return null;
  const tone = load.total > capacity ? "tag bad" : "";
  return <span class={tone}>{TEXT.linkAfterwards(number((100 * load.total) / capacity, 1), number(rate, 0))}</span>;
}

function Progress({ model, id }: { readonly model: Model; readonly id: number }) {
  const job = jobOf(model, id);
  const bar = useRef<HTMLDivElement>(null);
  // The bar with "Apply" is gone; keyboard users keep their focus at its place.
  useEffect(() => {
    if (document.activeElement === document.body || document.activeElement === null) bar.current?.focus();
  }, [id]);
  const dismiss = (): void => {
    model.applied.value = undefined;
    document.getElementById("form")?.focus();
  };
  return (
    <div class="apply-bar" role="region" aria-label={TEXT.writeResult} tabIndex={-1} ref={bar}>
      <div class="grow">
        <JobLine model={model} id={id} />
      </div>
      {job && isOver(job) && <Button look="edge" words={tookAll(job) ? TEXT.ok : TEXT.editAgain} onClick={dismiss} />}
    </div>
  );
}

const tookAll = (job: Job): boolean => job.state === "done" && job.outcomes.length === 0;

/** Writes what was changed; what could harm is asked once more, in the words of the server, which knows it for every way to write. */
async function apply(model: Model, names: readonly string[], confirmed = false): Promise<void> {
  if (isViewOnly.value) return;
  const body = {
    changes: model.changes.value,
    reason: model.reason.value,
    confirmed,
    devices: [],
    product: "",
    base: model.basesOf(names),
    confirm_s: null,
  };
  model.page.wrote(model.id);
  const outcome = await configureApi.apply(model.writeName, body);
  if (!confirmed && !outcome.ok && outcome.problem.kind === "confirm") {
    await model.asking.now(names); // A quick user applies before the preview has said that the change is temporary.
    const temporary = names.some((name) => model.previews.value[name]?.line);
    const caution = names.map((name) => model.setting(name)?.caution ?? "").find((one) => one !== "");
    model.page.question.value = {
      title: TEXT.confirmWrite,
      about: model.fullName,
      words: [outcome.problem.message],
      caution: caution ?? (temporary ? "cuts-line" : "restarts"),
      go: temporary ? TEXT.writeThenConfirm : TEXT.write,
      act: () => void apply(model, names, true),
    };
    return;
  }
  const job = await model.run(Promise.resolve(outcome));
  if (job === undefined) return;
  model.applied.value = job.id;
  model.reason.value = "";
  model.elsewhere.value = [];
}
