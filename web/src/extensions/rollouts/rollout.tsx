/**
 * One profile for several devices: the differences of each are shown first, each with a tick of its own; what is ticked is written by a job
 * of the device, whose result is shown in its row. The ticks of the device that the page is about stand in the comparison above.
 */
import { effect, type Signal, signal, useSignal } from "@preact/signals";
import type { Store } from "../../data/store";
import type { Difference, SideRef } from "../../wire/form-types";
import type { Present } from "../../forms/edits";
import { Button } from "../../ui/controls/button";
import type { Outcome, HttpProblem } from "../../requests/http";
import { useAnswer } from "../../requests/use-answer";
import { Message } from "../../ui/controls/message";
import { fullName, shortName } from "../../wire/device-name";
import type { DeviceInfo, Job } from "../../wire/types";
import { isOver, jobIn, Outcomes, stateWords } from "../../pages/configure/jobs";
import type { Model } from "../../pages/configure/model";
import { configureApi } from "../../pages/configure/api";
import { refFor } from "../../pages/configure/sides";
import type { ComparisonActionProps, Take } from "../../pages/configure/compare";
import { madeFor } from "../../page/app-state";
import { TableHead } from "../../ui/controls/table-head";
import "./rollouts.css";
import { isViewOnly } from "../../wire/capabilities";
import { COMMON } from "../../texts/common";
import { TEXT as CONFIGURE } from "../../texts/configure";
import { TEXT } from "./texts";

type AllJobs = Store["jobs"]["value"];
/** The comparison of a device, and the values that it had then. */
type Check = Outcome<Difference & { readonly base: Present }>;
type Checks = Readonly<Record<string, Check>>;

/** Result for each device of a profile: the job as last seen (without id: from an earlier run of the server), or why it has none. */
type RolloutResults = Readonly<
  Record<
    string,
    { readonly id: number | undefined; readonly last: Job | undefined } | { readonly problem: HttpProblem }
  >
>;

/** They stay until they are dismissed, whatever else is shown. */
const resultsOf = madeFor((store: Store) => {
  const results = signal<RolloutResults>({});
  effect(() => follow(results, store.jobs.value));
  return results;
});

/** Which differences of each further device are ticked, by their keys; of a device without any nothing is. */
type Ticks = Readonly<Record<string, Take>>;

export function RolloutSection({ model, store, others, side, take, title }: ComparisonActionProps) {
  const own = model.device.value;
  const devices = [...(own ? [own] : []), ...others].filter(({ id }) => refFor(side, "", model.id, id) !== undefined);
  const isOwnTicked = useSignal(side !== "device");
  const ticks = useSignal<Ticks>({});
  const results = resultsOf(store);
  const text = model.file.value?.text ?? "";
  const finished = devices.map(({ id }) => `${id}:${store.jobs.value.get(id)?.done[0]?.id ?? 0}`).join();
  const question = JSON.stringify([side, text, finished, take, ticks.value]);
  const asked = useAnswer<Checks>(question, async () => {
    const each = devices.map(async ({ id }): Promise<readonly (readonly [string, Check])[]> => {
      const right = refFor(side, text, model.id, id);
      const chosen = id === model.id ? { take } : { take: ticks.value[id] ?? {}, take_rest: false as const };
      return right === undefined ? [] : [[id, await compared(id, right, chosen)]];
    });
    return { ok: true, value: Object.fromEntries((await Promise.all(each)).flat()) };
  });
  const checks = asked.answer ?? {};
  if (devices.length === 0) return null;
  // not by an answer to other ticks: it would write what is not ticked any more
  const ready = asked.isOld
    ? []
    : devices.filter(({ id }) => (id !== model.id || isOwnTicked.value) && isReady(checks[id]));
  /** All differences of a device, but for what distinguishes one sensor from another; or none. */
  const tickAll = async (id: string, isOn: boolean): Promise<void> => {
    if (id === model.id) {
      isOwnTicked.value = isOn;
      return;
    }
    const right = refFor(side, text, model.id, id);
    if (right === undefined) return;
    const usual = isOn ? await compared(id, right, { take: {} }) : undefined;
    const all = usual?.ok ? Object.fromEntries(usual.value.rows.map((row) => [row.key, row.take])) : {};
    ticks.value = { ...ticks.peek(), [id]: all };
  };
  const tick = (id: string, key: string, isOn: boolean): void => {
    ticks.value = { ...ticks.peek(), [id]: { ...ticks.peek()[id], [key]: isOn } };
  };
  return (
    <section class="rollout" aria-label={TEXT.applyProfile}>
      <h3>{TEXT.applyTitleTo(title)}</h3>
      <table class="result" data-old={asked.isOld || undefined} aria-busy={asked.isOld}>
        <TableHead
          of={[
            { text: <span class="visually-hidden">{TEXT.selected}</span> },
            ...[COMMON.device, TEXT.wouldChange, TEXT.result],
          ]}
        />
        <tbody>
          {devices.map((device) => (
            <Row
              key={device.id}
              model={model}
              store={store}
              device={device}
              check={checks[device.id]}
              isTicked={device.id === model.id && isOwnTicked.value}
              tickAll={(isOn) => void tickAll(device.id, isOn)}
              tick={(key, isOn) => tick(device.id, key, isOn)}
              results={results.value}
            />
          ))}
        </tbody>
      </table>
      <div class="adopt text-sm control-row">
        <Button
          look="main"
          words={ready.length > 1 ? TEXT.applyToDevices(ready.length) : TEXT.applyProfile}
          disabled={isViewOnly.value || ready.length === 0}
          onClick={() => ask(model, ready, title, checks, results)}
        />
        <span class="dim">{TEXT.rolloutSteps}</span>
        {Object.keys(results.value).length > 0 && (
          <Button look="small" words={TEXT.dismissResults} onClick={() => (results.value = {})} />
        )}
      </div>
    </section>
  );
}

/** Changes of a device; one that was never read is not compared. */
async function compared(
  device: string,
  right: SideRef,
  chosen: { readonly take: Take; readonly take_rest?: false },
): Promise<Check> {
  const body = await configureApi.values(device);
  if (!body.ok) return body;
  if (body.value.info.taken === 0)
    return { ok: false, problem: { status: 409, kind: "not-read", message: TEXT.notReadYetSentence, hint: "" } };
  const found = await configureApi.compare(device, {
    left: { side: "device", snapshot: "", device: "", text: "" },
    right,
    ...chosen,
  });
  return found.ok ? { ok: true, value: { ...found.value, base: body.value.values } } : found;
}

/** Whether it can be written: known, different, without problems. */
const isReady = (check: Check | undefined): boolean =>
  check?.ok === true &&
  Object.keys(check.value.changes).length > 0 &&
  check.value.problems.length === 0 &&
  check.value.blocked === "";

/** Whether a profile has something for a device that it can be given. */
const isOffered = (check: Check | undefined): boolean =>
  check?.ok === true && check.value.rows.some(({ writable }) => writable) && check.value.problems.length === 0;

interface RowProps {
  readonly model: Model;
  readonly store: Store;
  readonly device: DeviceInfo;
  readonly check: Check | undefined;
  /** Of the device that the page is about: whether it is written to. */
  readonly isTicked: boolean;
  readonly tickAll: (isOn: boolean) => void;
  readonly tick: (key: string, isOn: boolean) => void;
  readonly results: RolloutResults;
}

function Row({ model, store, device, check, isTicked, tickAll, tick, results }: RowProps) {
  const isOwn = device.id === model.id;
  const writable = check?.ok ? check.value.rows.filter((row) => row.writable) : [];
  const total = writable.filter((row) => row.take).length;
  const isOn = isOwn ? isTicked && isReady(check) : total > 0;
  return (
    <tr data-device={device.id}>
      <td>
        <label class="tick">
          <input
            type="checkbox"
            class="check"
            aria-label={TEXT.applyToDevice(fullName(device))}
            checked={isOn}
            indeterminate={!isOwn && total > 0 && total < writable.length}
            disabled={isViewOnly.value || !(isOwn ? isReady(check) : isOffered(check))}
            onChange={() => tickAll(!isOn)}
          />
        </label>
      </td>
      <th scope="row">
        {shortName(device)} <span class="mono dim">{device.serial_number}</span>
        {isOwn && <small class="dim">{TEXT.thisDevice}</small>}
      </th>
      <td>
        <Changes model={model} device={device} check={check} tick={isOwn ? undefined : tick} />
      </td>
      <td>
        <Result store={store} device={device.id} results={results} />
      </td>
    </tr>
  );
}

interface ChangesProps extends Pick<RowProps, "model" | "device" | "check"> {
  /** Ticks one difference; undefined where the ticks stand in the comparison above. */
  readonly tick: RowProps["tick"] | undefined;
}

function Changes({ model, device, check, tick }: ChangesProps) {
  if (check === undefined) return <span class="dim">{TEXT.comparing}</span>;
  if (!check.ok) {
    return (
      <>
        <span class="mid">
          <Message text={check.problem.message} />
        </span>{" "}
        {check.problem.kind === "not-read" && (
          <Button
            changes
            look="small edge"
            words={TEXT.readDevice(fullName(device))}
            onClick={() => void model.run(configureApi.read(device.id))}
          />
        )}
      </>
    );
  }
  const found = check.value;
  const total = found.rows.filter(({ take }) => take).length;
  const all = found.rows.filter(({ writable }) => writable).length;
  const absent = [
    ...found.rows.flatMap(({ title, why }) => (why ? [[title, why] as const] : [])),
    ...Object.entries(found.missing),
  ];
  const against = [
    ...(found.blocked ? [found.blocked] : []),
    ...found.problems.map(({ path, message }) => `${path}: ${message}`),
  ];
  return (
    <>
      {all === 0 ? (
        <span class="dim">{found.rows.some(({ why }) => why) ? TEXT.nothingPossible : TEXT.alreadyApplied}</span>
      ) : tick === undefined ? (
        <span class={total === 0 ? "dim" : ""}>{total === 0 ? TEXT.nothingSelected : TEXT.tickedAbove(total)}</span>
      ) : (
        <details open={total > 0}>
          <summary>{TEXT.tickedOf(total, all)}</summary>
          <ul class="ticks">
            {found.rows
              .filter(({ writable }) => writable)
              .map((row) => (
                <li key={row.key}>
                  <label class="tick">
                    <input
                      type="checkbox"
                      class="check"
                      checked={row.take}
                      disabled={isViewOnly.value || against.length > found.blocked.length}
                      onChange={({ currentTarget }) => tick(row.key, currentTarget.checked)}
                    />{" "}
                    <span>{TEXT.change(row.title, row.left || CONFIGURE.missing, row.right || CONFIGURE.missing)}</span>
                  </label>
                </li>
              ))}
          </ul>
        </details>
      )}
      {tick !== undefined && absent.length > 0 && (
        <details>
          <summary>{TEXT.leftOut(absent.length)}</summary>
          <ul class="dim">
            {absent.map(([title, why]) => (
              <li key={title}>
                {title}: <Message text={why} />
              </li>
            ))}
          </ul>
        </details>
      )}
      {against.map((words) => (
        <p class="why-not" key={words}>
          {words}
        </p>
      ))}
      {found.dangers.map((words) => (
        <p class="caution" key={words}>
          ▲ <Message text={words} />
        </p>
      ))}
    </>
  );
}

function Result({
  store,
  device,
  results,
}: {
  readonly store: Store;
  readonly device: string;
  readonly results: RolloutResults;
}) {
  const result = results[device];
  if (result === undefined) return <span class="dim">—</span>;
  if ("problem" in result) {
    return (
      <span class="why-not" role="alert">
        {TEXT.rejectedLabel} <Message text={result.problem.message} /> <Message text={result.problem.hint} />
      </span>
    );
  }
  const job = jobOf(store.jobs.value, device, result.id) ?? result.last;
  if (job === undefined) return <span class="dim">{result.id === undefined ? TEXT.unknown : CONFIGURE.sent}</span>;
  return (
    <div role="status">
      <span
        class={`dot ${job.state === "failed" ? "bad" : isOver(job) ? (job.outcomes.length > 0 ? "warn" : "live") : "off"}`}
      />{" "}
      <Message text={stateWords(job)} />
      {job.hint !== "" && (
        <p class="dim">
          <Message text={job.hint} />
        </p>
      )}
      <Outcomes outcomes={job.outcomes} />
    </div>
  );
}

const jobOf = (jobs: AllJobs, device: string, id: number | undefined): Job | undefined =>
  id === undefined ? undefined : jobIn(jobs.get(device), id);

/** Keep the results of jobs here; the server keeps only a few jobs, and another run of it renumbers them. */
function follow(results: Signal<RolloutResults>, jobs: AllJobs): void {
  const next: Record<string, RolloutResults[string]> = { ...results.value };
  let changed = false;
  for (const [device, result] of Object.entries(next)) {
    if ("problem" in result || result.id === undefined) continue;
    const job = jobOf(jobs, device, result.id);
    if (jobs.size === 0)
      next[device] = { id: undefined, last: result.last && isOver(result.last) ? result.last : undefined };
    else if (job === undefined || job === result.last) continue;
    else next[device] = { ...result, last: job };
    changed = true;
  }
  if (changed) results.value = next;
}

/** Name every device and what is done to it, and ask; then write each. */
function ask(
  model: Model,
  devices: readonly DeviceInfo[],
  title: string,
  checks: Checks,
  results: Signal<RolloutResults>,
): void {
  const found = devices.flatMap((device) => {
    const check = checks[device.id];
    return check?.ok === true ? [{ device, named: model.writeNameOf(device.id), check: check.value }] : [];
  });
  const act = (): void => {
    for (const { device, named, check } of found) {
      const { changes, product, base } = check;
      const own = Object.entries(base).filter(([name]) => name in changes);
      model.page.wrote(device.id);
      void configureApi
        .apply(named, {
          changes,
          reason: TEXT.profile(title),
          confirmed: true,
          devices: [],
          product,
          base: Object.fromEntries(own),
          confirm_s: null,
        })
        .then((answer) => {
          results.value = {
            ...results.peek(),
            [device.id]: answer.ok ? { id: answer.value.id, last: undefined } : { problem: answer.problem },
          };
        });
    }
  };
  const isTemporary = found.some(({ check }) => check.temporary);
  model.page.question.value = {
    title: TEXT.confirmRollout(title, found.length),
    about: "",
    words: found.map(({ device, check }) => {
      const values = check.rows.flatMap((row) => (row.take ? [row.title] : []));
      return [TEXT.rolloutOf(fullName(device), values.length, values.join(", ")), ...check.dangers].join(" ");
    }),
    caution: isTemporary ? "cuts-line" : "",
    go: isTemporary ? CONFIGURE.writeThenConfirm : TEXT.writeProfile,
    act,
  };
}
