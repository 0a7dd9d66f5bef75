/** Plan of a rollout: which robots, which of their settings, in which waves; starting it needs a name. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { dateWords } from "../../../recordings/library-filter";
import { Button } from "../../../ui/controls/button";
import { type HttpProblem, request } from "../../../requests/http";
import { Message } from "../../../ui/controls/message";
import { storedName, storeName } from "../../../requests/person-name";
import { ProblemNote } from "../../../requests/problem-note";
import type { DeviceLeftOut, PlannedDevice, RolloutChanges, RolloutPlan } from "../../../wire/routes";
import { TableHead } from "../../../ui/controls/table-head";
import { TEXT as FLEET } from "./texts";
import { TEXT } from "./rollout-texts";

const WAVES = "1, 5, 25 %";
const WATCH_S = 10;
/** Robots that are named of those with the same changes. */
const MAX_NAMED = 6;
/** Waves whose sizes are listed. */
const MAX_LISTED = 12;

interface Props {
  readonly robot: string;
  readonly device: string;
  /** Shows a rollout that was started, or is under way. */
  readonly follow: (id: number) => void;
}

export function RolloutPlanForm({ robot, device, follow }: Props) {
  const plan = useSignal<RolloutPlan | undefined>(undefined);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const waves = useSignal(WAVES);
  const isBusy = useSignal(false);
  const ask = async (): Promise<boolean> => {
    const query = { device, waves: waves.peek() };
    const outcome = await request("GET /api/fleet/robots/{robot}/rollout", { path: { robot }, query });
    if (!outcome.ok) problem.value = outcome.problem;
    else if (outcome.value.running !== null) follow(outcome.value.running);
    else plan.value = outcome.value;
    return outcome.ok;
  };
  // biome-ignore lint/correctness/useExhaustiveDependencies: asked once; other waves ask themselves
  useEffect(() => {
    void ask();
  }, [robot, device]);
  const change = async (text: string): Promise<void> => {
    waves.value = text;
    if (await ask()) problem.value = undefined;
  };
  /** By its button alone: Enter in a field, which ends the typing of the waves, starts nothing. */
  const submit = async (form: HTMLFormElement | null): Promise<void> => {
    if (form === null || !form.reportValidity()) return;
    const given = new FormData(form);
    const by = String(given.get("by") ?? "").trim();
    if (by === "" || plan.value === undefined || isBusy.value) return;
    storeName(by);
    isBusy.value = true;
    const how = { waves: String(given.get("waves") ?? WAVES), watch_s: Number(given.get("watch_s") ?? WATCH_S) };
    const body = { device, plan: plan.value.id, by, ...how };
    const outcome = await request("POST /api/fleet/robots/{robot}/rollout", { path: { robot }, body });
    isBusy.value = false;
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) follow(outcome.value.id);
    else await ask();
  };
  const found = plan.value;
  if (found === undefined) {
    return problem.value ? <ProblemNote problem={problem.value} /> : <p class="dim">{TEXT.comparing}</p>;
  }
  const n = found.devices.length;
  return (
    <form class="stacked" onSubmit={(event) => event.preventDefault()}>
      <p>
        {n > 0 ? TEXT.differs(n, found.product, found.group) : TEXT.nothing(found.product, found.group)}{" "}
        <span class="dim">
          {TEXT.same(found.same)} {TEXT.origin(found.profile.robot, found.profile.by, dateWords(found.profile.time))}
        </span>
      </p>
      {found.changes.map((one, place) => (
        <Changes
          key={JSON.stringify(one)}
          changes={one}
          devices={found.devices.filter(({ change }) => change === place)}
        />
      ))}
      {found.left_out.length > 0 && <LeftOut devices={found.left_out} isOpen={n === 0} />}
      {n > 0 && (
        <>
          <div class="rollout-how">
            <label class="labelled">
              <span>{TEXT.waves}</span>
              <input
                name="waves"
                type="text"
                maxLength={100}
                required
                title={TEXT.wavesHint}
                defaultValue={WAVES}
                onChange={(event) => void change(event.currentTarget.value)}
              />
            </label>
            <label class="labelled">
              <span>{TEXT.watch}</span>
              <span class="with-unit">
                <input
                  name="watch_s"
                  type="number"
                  min={1}
                  max={300}
                  step="any"
                  required
                  title={TEXT.watchHint}
                  defaultValue={WATCH_S}
                />
                <span class="unit">{TEXT.watchUnit}</span>
              </span>
            </label>
            <label class="labelled">
              <span>{FLEET.yourName}</span>
              <input
                name="by"
                type="text"
                maxLength={60}
                required
                autocomplete="name"
                title={FLEET.yourNameHint}
                defaultValue={storedName()}
              />
            </label>
          </div>
          <p class="dim">{sizesOf(found.waves)}</p>
          <p class="dim">{TEXT.promise}</p>
        </>
      )}
      {problem.value && <ProblemNote problem={problem.value} />}
      {n > 0 && (
        <div class="ends">
          <Button
            changes
            look="main"
            words={TEXT.start(n)}
            disabled={isBusy.value}
            onClick={(event) => void submit(event.currentTarget.form)}
          />
        </div>
      )}
    </form>
  );
}

function sizesOf(waves: readonly number[]): string {
  const first = waves.slice(0, MAX_LISTED).join(", ");
  return waves.length > MAX_LISTED ? TEXT.manySizes(first, waves.length) : TEXT.sizes(first);
}

interface ChangesProps {
  readonly changes: RolloutChanges;
  readonly devices: readonly PlannedDevice[];
}

function Changes({ changes, devices }: ChangesProps) {
  const named = devices.slice(0, MAX_NAMED).map(({ robot }) => robot);
  const others = devices.slice(MAX_NAMED).map(({ robot }) => robot);
  return (
    <section>
      <h3>
        {named.join(", ")}
        {others.length > 0 && <span title={others.join("\n")}> {TEXT.more(others.length)}</span>}
      </h3>
      <table class="profile-table">
        <TableHead of={[TEXT.settingTitle, TEXT.nowTitle, TEXT.profileTitle]} />
        <tbody>
          {changes.rows.map(({ title, now, profile }) => (
            <tr key={title}>
              <td>{title}</td>
              <td>{now || TEXT.nothingValue}</td>
              <td class="new">{profile || TEXT.nothingValue}</td>
            </tr>
          ))}
        </tbody>
      </table>
      {changes.risks.map((words) => (
        <p class="risk" key={words}>
          <span class="dot warn" /> <Message text={words} />
        </p>
      ))}
    </section>
  );
}

function LeftOut({ devices, isOpen }: { readonly devices: readonly DeviceLeftOut[]; readonly isOpen: boolean }) {
  return (
    <details open={isOpen}>
      <summary>{TEXT.leftOut(devices.length)}</summary>
      <ul class="rollout-left text-sm">
        {devices.map(({ robot, device, name, why }) => (
          <li key={`${robot} ${device}`}>
            <b>{TEXT.deviceOf(robot, name)}</b> <Message text={why} />
          </li>
        ))}
      </ul>
    </details>
  );
}
