/** Plan of a rollout: which robots, which of their settings, in which waves; starting it needs a name. */
import { useSignal } from "@preact/signals";
import { useRef } from "preact/hooks";
import { dateWords } from "../../../recordings/library-filter";
import { Button } from "../../../ui/controls/button";
import { type HttpProblem, request } from "../../../requests/http";
import { Message } from "../../../ui/controls/message";
import { storedName, storeName } from "../../../requests/person-name";
import { ProblemNote } from "../../../requests/problem-note";
import { Answered, useAnswer } from "../../../requests/use-answer";
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
  /** Why it was not started. */
  const refused = useSignal<HttpProblem | undefined>(undefined);
  const waves = useSignal(WAVES);
  const isBusy = useSignal(false);
  const turn = useSignal(0);
  const asked = useAnswer(JSON.stringify([robot, device, waves.value, turn.value]), async () => {
    const query = { device, waves: waves.peek() };
    const outcome = await request("GET /api/fleet/robots/{robot}/rollout", { path: { robot }, query });
    if (!outcome.ok || outcome.value.running === null) return outcome;
    follow(outcome.value.running);
    return undefined;
  });
  const plan = asked.isOld ? undefined : asked.answer;
  const known = useRef(0); // the fields stay while waves are refused that were typed into one of them
  known.current = asked.answer?.devices.length ?? known.current;
  /** By its button alone: Enter in a field, which ends the typing of the waves, starts nothing. */
  const submit = async (form: HTMLFormElement | null): Promise<void> => {
    if (form === null || !form.reportValidity()) return;
    const given = new FormData(form);
    const by = String(given.get("by") ?? "").trim();
    if (by === "" || plan === undefined || isBusy.value) return;
    storeName(by);
    isBusy.value = true;
    const how = { waves: String(given.get("waves") ?? WAVES), watch_s: Number(given.get("watch_s") ?? WATCH_S) };
    const body = { device, plan: plan.id, by, ...how };
    const outcome = await request("POST /api/fleet/robots/{robot}/rollout", { path: { robot }, body });
    isBusy.value = false;
    refused.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) follow(outcome.value.id);
    else turn.value++;
  };
  const n = known.current;
  const problem = refused.value ?? asked.problem;
  return (
    <form class="stacked" onSubmit={(event) => event.preventDefault()}>
      <Answered of={{ ...asked, problem: undefined }} waiting={!asked.problem && <p class="dim">{TEXT.comparing}</p>}>
        {(found) => <Plan found={found} />}
      </Answered>
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
                onChange={(event) => {
                  waves.value = event.currentTarget.value;
                  refused.value = undefined;
                }}
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
          {asked.answer && <p class="dim">{sizesOf(asked.answer.waves)}</p>}
          <p class="dim">{TEXT.promise}</p>
        </>
      )}
      {problem && <ProblemNote problem={problem} />}
      {n > 0 && (
        <div class="ends">
          <Button
            changes
            look="main"
            words={TEXT.start(n)}
            disabled={isBusy.value || plan === undefined}
            onClick={(event) => void submit(event.currentTarget.form)}
          />
        </div>
      )}
    </form>
  );
}

function Plan({ found }: { readonly found: RolloutPlan }) {
  const n = found.devices.length;
  return (
    <>
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
    </>
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
