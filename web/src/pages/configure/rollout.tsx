/**
 * One profile for several devices: the changes of each are shown first, with their problems; then each is written by a job of its own,
 * whose result is shown in its row.
 */
import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Store } from "../../data/store";
import type { Difference, SideRef } from "../../forms/types";
import type { Outcome, Problem } from "../../ui/http";
import { Message } from "../../ui/message";
import type { DeviceInfo, Job } from "../../wire/types";
import { isOver, jobIn, Outcomes, stateWords } from "./jobs";
import type { Model } from "./model";
import { server } from "./api";
import { refFor, type Side } from "./sides";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";

type Checks = Readonly<Record<string, Outcome<Difference>>>;
/** Result of a device: the job that writes it, as last seen, or why there is none. */
type Results = Readonly<
  Record<string, { readonly id: number; readonly last: Job | undefined } | { readonly problem: Problem }>
>;

interface Props {
  readonly model: Model;
  readonly store: Store;
  readonly others: readonly DeviceInfo[];
  readonly side: Side;
  readonly title: string;
}

export function Rollout({ model, store, others, side, title }: Props) {
  const own = model.device.value;
  const devices = [...(own ? [own] : []), ...others].filter(({ id }) => refFor(side, "", model.id, id) !== undefined);
  const checks = useSignal<Checks>({});
  const ticked = useSignal<ReadonlySet<string>>(new Set(side === "device" ? [] : [model.id]));
  const results = useSignal<Results>({});
  const text = model.file.value?.text ?? "";
  const finished = devices.map(({ id }) => `${id}:${store.jobs.value.get(id)?.done[0]?.id ?? 0}`).join();
  // biome-ignore lint/correctness/useExhaustiveDependencies: what is read besides is the newest, and no reason to begin again
  useEffect(() => {
    let stale = false;
    for (const { id } of devices) {
      const right = refFor(side, text, model.id, id);
      if (right === undefined) continue;
      void compared(id, right).then((answer) => {
        if (!stale) checks.value = { ...checks.peek(), [id]: answer };
      });
    }
    return () => {
      stale = true;
    };
  }, [side, text, finished]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: what is read besides is the newest, and no reason to begin again
  useEffect(() => follow(results, store), [store.jobs.value]);
  if (devices.length === 0) return null;
  const ready = devices.filter(({ id }) => ticked.value.has(id) && isReady(checks.value[id]));
  return (
    <section class="rollout" aria-label={TEXT.applyProfile}>
      <h3>{TEXT.applyTitleTo(title)}</h3>
      <table>
        <thead>
          <tr>
            <th>
              <span class="visually-hidden">{TEXT.selected}</span>
            </th>
            <th>{COMMON.device}</th>
            <th>{TEXT.wouldChange}</th>
            <th>{TEXT.result}</th>
          </tr>
        </thead>
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
      <div class="adopt">
        <button
          type="button"
          class="btn main"
          disabled={model.page.viewOnly.value || ready.length === 0}
          onClick={() => ask(model, ready, title, checks.value, results)}
        >
          {ready.length > 1 ? TEXT.applyToDevices(ready.length) : TEXT.applyProfile}
        </button>
        <span class="dim">{TEXT.rolloutSteps}</span>
      </div>
    </section>
  );
}

/** Changes of a device; one that was never read is not compared. */
async function compared(device: string, right: SideRef): Promise<Outcome<Difference>> {
  const body = await server.values(device);
  if (!body.ok) return body;
  if (body.value.info.taken === 0)
    return { ok: false, problem: { status: 409, kind: "not-read", message: TEXT.notReadYetSentence, hint: "" } };
  return server.compare(device, { left: { side: "device", snapshot: "", device: "", text: "" }, right });
}

/** Whether it can be written: known, different, without problems. */
const isReady = (check: Outcome<Difference> | undefined): boolean =>
  check?.ok === true &&
  Object.keys(check.value.changes).length > 0 &&
  check.value.problems.length === 0 &&
  check.value.blocked === "";

interface RowProps {
  readonly model: Model;
  readonly store: Store;
  readonly device: DeviceInfo;
  readonly check: Outcome<Difference> | undefined;
  readonly ticked: Signal<ReadonlySet<string>>;
  readonly results: Results;
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
            aria-label={TEXT.applyToDevice(device.name)}
            checked={ticked.value.has(device.id)}
            disabled={!isReady(check)}
            onChange={toggle}
          />
        </label>
      </td>
      <th scope="row">
        {device.name} <span class="mono dim">{device.serial_number}</span>
        {device.id === model.id && <small class="dim">{TEXT.thisDevice}</small>}
      </th>
      <td>
        <Check model={model} device={device} check={check} />
      </td>
      <td>
        <Result store={store} device={device.id} results={results} />
      </td>
    </tr>
  );
}

function Check({ model, device, check }: Pick<RowProps, "model" | "device" | "check">) {
  if (check === undefined) return <span class="dim">{TEXT.comparing}</span>;
  if (!check.ok) {
    return (
      <>
        <span class="mid">
          <Message text={check.problem.message} />
        </span>{" "}
        {check.problem.kind === "not-read" && (
          <button
            type="button"
            class="btn small edge"
            disabled={model.page.viewOnly.value}
            onClick={() => void model.run(server.read(device.id))}
          >
            {TEXT.readDevice(device.name)}
          </button>
        )}
      </>
    );
  }
  const found = check.value;
  const rows = found.rows.filter(({ writable }) => writable);
  const against = [
    ...(found.blocked ? [found.blocked] : []),
    ...found.problems.map(({ path, message }) => `${path}: ${message}`),
  ];
  return (
    <>
      {rows.length === 0 ? (
        <span class="dim">{TEXT.alreadyApplied}</span>
      ) : (
        <details>
          <summary>{TEXT.valueCount(rows.length)}</summary>
          <ul class="dim">
            {rows.map(({ setting, path, title, left, right }) => (
              <li key={`${setting} ${path}`}>
                {title}: {left || TEXT.missing} → {right || TEXT.missing}
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
  readonly results: Results;
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
  const job = jobIn(store.jobs.value.get(device), result.id) ?? result.last;
  if (job === undefined) return <span class="dim">{TEXT.sent}</span>;
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

/** Keep the results of jobs here; the server keeps only a few jobs. */
function follow(results: Signal<Results>, store: Store): void {
  const next: Record<string, Results[string]> = { ...results.peek() };
  let changed = false;
  for (const [device, result] of Object.entries(next)) {
    if ("problem" in result) continue;
    const job = jobIn(store.jobs.value.get(device), result.id);
    if (job === undefined || job === result.last) continue;
    next[device] = { ...result, last: job };
    changed = true;
  }
  if (changed) results.value = next;
}

/** Ask for confirmation of possible harm, for every device; then write each. */
function ask(
  model: Model,
  devices: readonly DeviceInfo[],
  title: string,
  checks: Checks,
  results: Signal<Results>,
): void {
  const act = (): void => {
    for (const { id } of devices) {
      const check = checks[id];
      if (check?.ok !== true) continue;
      const { profile, product } = check.value;
      void server
        .apply(id, {
          changes: profile,
          reason: TEXT.profile(title),
          confirmed: true,
          devices: [],
          product,
          base: {},
          confirm_s: null,
        })
        .then((answer) => {
          results.value = {
            ...results.peek(),
            [id]: answer.ok ? { id: answer.value.id, last: undefined } : { problem: answer.problem },
          };
        });
    }
  };
  const dangers = devices.flatMap(({ id, name, serial_number }) => {
    const check = checks[id];
    return check?.ok === true ? check.value.dangers.map((words) => `${name} ${serial_number}: ${words}`) : [];
  });
  if (dangers.length === 0) return act();
  model.page.question.value = {
    title: TEXT.confirmRollout(title, devices.length),
    words: dangers,
    caution: "",
    go: TEXT.writeProfile,
    act,
  };
}
