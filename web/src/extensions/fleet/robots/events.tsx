/** What happened on one robot, asked for when it is opened, and removing a robot that is lost. */
import { useSignal } from "@preact/signals";
import { dayWords } from "../../../recordings/library-filter";
import { Button } from "../../../ui/controls/button";
import { clock } from "../../../ui/format/format";
import { type HttpProblem, request } from "../../../requests/http";
import { ProblemNote } from "../../../requests/problem-note";
import type { FleetEvent } from "../../../wire/routes";
import type { Fleet } from "./fleet-state";
import { TEXT } from "./texts";

/** How many events of a robot are shown. */
const NEWEST = 30;

export function RobotEvents({ name }: { readonly name: string }) {
  const events = useSignal<readonly FleetEvent[] | undefined>(undefined);
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const load = async (): Promise<void> => {
    const outcome = await request("GET /api/fleet/events", { query: { robot: name, limit: NEWEST } });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) events.value = outcome.value;
  };
  return (
    <details class="fleet-events" onToggle={(event) => event.currentTarget.open && void load()}>
      <summary>{TEXT.events}</summary>
      {problem.value && <ProblemNote problem={problem.value} />}
      {events.value?.length === 0 && <p class="dim">{TEXT.noEvent}</p>}
      <ul>
        {events.value?.map(({ id, time, level, text }) => (
          <li key={id}>
            <span class={`dot ${level === "error" ? "bad" : level === "info" ? "off" : "warn"}`} />
            <span>{text}</span>
            <time class="dim" dateTime={new Date(time * 1000).toISOString()}>
              {dayWords(time)} {clock(time)}
            </time>
          </li>
        ))}
      </ul>
    </details>
  );
}

export function RemoveRobot({ name, fleet }: { readonly name: string; readonly fleet: Fleet }) {
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const remove = async (): Promise<void> => {
    const outcome = await request("DELETE /api/fleet/robots/{robot}", { path: { robot: name } });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) return;
    fleet.open("");
    fleet.retry();
  };
  return (
    <>
      <p class="dim">{TEXT.removeHint}</p>
      <Button changes look="edge" words={TEXT.remove} onClick={() => void remove()} />
      {problem.value && <ProblemNote problem={problem.value} />}
    </>
  );
}
