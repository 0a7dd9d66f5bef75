/**
 * One profile for several devices: the changes of each are shown first, with their problems; then each is written by a job of its own,
 * whose result is shown in its row.
 */
import { effect, type Signal, signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Store } from "../../data/store";
import type { Difference, SideRef } from "../../forms/types";
import type { Present } from "../../forms/edits";
import { Button } from "../../ui/button";
import type { Outcome, HttpProblem } from "../../ui/http";
import { Message } from "../../ui/message";
import { fullName, shortName } from "../../wire/device-name";
import type { DeviceInfo, Job } from "../../wire/types";
import { isOver, jobIn, Outcomes, stateWords } from "../../pages/configure/jobs";
import type { Model } from "../../pages/configure/model";
import { configureApi } from "../../pages/configure/api";
import { refFor } from "../../pages/configure/sides";
import type { ComparisonActionProps } from "../../pages/configure/compare";
import { madeFor } from "../../pages/app-state";
import { TableHead } from "../../ui/table-head";
import "./rollouts.css";
import { COMMON } from "../../texts/common";
import { TEXT as CONFIGURE } from "../../texts/configure";
import { TEXT } from "./texts";

type AllJobs = Store["jobs"]["value"];
/** The comparison of a device, and the values that it had then. */
type Check = Outcome<Difference & { readonly base: Present }>;
type Checks = Readonly<Record<string, Check>>;

/** Result of each device that a profile was written to: the job (no id: of an earlier run of the server), as last seen, or why there is none. */
type RolloutResults = Readonly<
  Record<
    string,
    { readonly id: number | undefined; readonly last: Job | undefined } | { readonly problem: HttpProblem }
  >
>;

/** They stay until they are dismissed, whatever is shown meanwhile. */
const resultsOf = madeFor((store: Store) => {
  const results = signal<RolloutResults>({});
  effect(() => follow(results, store.jobs.value));
  return results;
});

export function RolloutSection({ model, store, others, side, take, title }: ComparisonActionProps) {
  const own = model.device.value;
  const devices = [...(own ? [own] : []), ...others].filter(({ id }) => refFor(side, "", model.id, id) !== undefined);
  const checks = useSignal<Checks>({});
  const ticked = useSignal<ReadonlySet<string>>(new Set(side === "device" ? [] : [model.id]));
  const results = resultsOf(store);
  const text = model.file.value?.text ?? "";
  const finished = devices.map(({ id }) => `${id}:${store.jobs.value.get(id)?.done[0]?.id ?? 0}`).join();
  // biome-ignore lint/correctness/useExhaustiveDependencies: what is read besides is the newest, and no reason to begin again
  useEffect(() => {
    let stale = false;
    for (const { id } of devices) {
      const right = refFor(side, text, model.id, id);
      if (right === undefined) continue;
      void compared(id, right, take).then((answer) => {
        if (!stale) checks.value = { ...checks.peek(), [id]: answer };
      });
    }
    return () => {
      stale = true;
    };
  }, [side, text, finished, take]);
  if (devices.length === 0) return null;
  const ready = devices.filter(({ id }) => ticked.value.has(id) && isReady(checks.value[id]));
  return (
    <section class="rollout" aria-label={TEXT.applyProfile}>
      <h3>{TEXT.applyTitleTo(title)}</h3>
      <table>
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
              check={checks.value[device.id]}
              ticked={ticked}
              results={results.value}
            />
          ))}
        </tbody>
      </table>
      <div class="adopt control-row">
        <Button
          look="main"
          words={ready.length > 1 ? TEXT.applyToDevices(ready.length) : TEXT.applyProfile}
          disabled={model.page.viewOnly.value || ready.length === 0}
          onClick={() => ask(model, ready, title, checks.value, results)}
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
async function compared(device: string, right: SideRef, take: ComparisonActionProps["take"]): Promise<Check> {
  const body = await configureApi.values(device);
  if (!body.ok) return body;
  if (body.value.info.taken === 0)
    return { ok: false, problem: { status: 409, kind: "not-read", message: TEXT.notReadYetSentence, hint: "" } };
  const found = await configureApi.compare(device, {
    left: { side: "device", snapshot: "", device: "", text: "" },
    right,
    take,
  });
  return found.ok ? { ok: true, value: { ...found.value, base: body.value.values } } : found;
}

/** Whether it can be written: known, different, without problems. */
const isReady = (check: Check | undefined): boolean =>
  check?.ok === true &&
  Object.keys(check.value.changes).length > 0 &&
  check.value.problems.length === 0 &&
  check.value.blocked === "";

interface RowProps {
  readonly model: Model;
  readonly store: Store;
  readonly device: DeviceInfo;
  readonly check: Check | undefined;
  readonly ticked: Signal<ReadonlySet<string>>;
  readonly results: RolloutResults;
}

function Row({ model, store, device, check, ticked, results }: RowProps) {
  const toggle = (): void => {
    const next = new Set(ticked.value);
    if (!next.delete(device.id)) next.add(device.id);
    ticked.value = next;
  };
  return (
    <tr data-device={device.id}>
      <td>
        <label class="tick">
          <input
            type="checkbox"
            class="check"
            aria-label={TEXT.applyToDevice(fullName(device))}
            checked={ticked.value.has(device.id)}
            disabled={!isReady(check)}
            onChange={toggle}
          />
        </label>
      </td>
      <th scope="row">
        {shortName(device)} <span class="mono dim">{device.serial_number}</span>
        {device.id === model.id && <small class="dim">{TEXT.thisDevice}</small>}
      </th>
      <td>
        <Changes model={model} device={device} check={check} />
      </td>
      <td>
        <Result store={store} device={device.id} results={results} />
      </td>
    </tr>
  );
}

function Changes({ model, device, check }: Pick<RowProps, "model" | "device" | "check">) {
  if (check === undefined) return <span class="dim">{TEXT.comparing}</span>;
  if (!check.ok) {
    return (
      <>
        <span class="mid">
          <Message text={check.problem.message} />
        </span>{" "}
        {check.problem.kind === "not-read" && (
          <Button
            look="small edge"
            words={TEXT.readDevice(fullName(device))}
            disabled={model.page.viewOnly.value}
            onClick={() => void model.run(configureApi.read(device.id))}
          />
        )}
      </>
    );
  }
  const found = check.value;
  const rows = found.rows.filter(({ take }) => take);
  const against = [
    ...(found.blocked ? [found.blocked] : []),
    ...found.problems.map(({ path, message }) => `${path}: ${message}`),
  ];
  return (
    <>
      {rows.length === 0 ? (
        <span class="dim">
          {found.rows.some(({ writable }) => writable) ? TEXT.nothingSelected : TEXT.alreadyApplied}
        </span>
      ) : (
        <details>
          <summary>{TEXT.valueCount(rows.length)}</summary>
          <ul class="dim">
            {rows.map(({ setting, path, title, left, right }) => (
              <li key={`${setting} ${path}`}>
                {title}: {left || CONFIGURE.missing} → {right || CONFIGURE.missing}
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

/** Keep the results of jobs here; the server keeps only a few jobs, and another run of it numbers them anew. */
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
  model.page.question.value = {
    title: TEXT.confirmRollout(title, found.length),
    about: "",
    words: found.map(({ device, check }) =>
      [TEXT.rolloutOf(fullName(device), check.rows.filter(({ take }) => take).length), ...check.dangers].join(" "),
    ),
    caution: "",
    go: TEXT.writeProfile,
    act,
  };
}
