/** Raised alarms of a robot: its own, and those of the fleet server, which are acknowledged here. */
import { useSignal } from "@preact/signals";
import { Button } from "../../../ui/controls/button";
import { type HttpProblem, request } from "../../../requests/http";
import { ProblemNote } from "../../../requests/problem-note";
import type { RobotAlarm, RobotSummary } from "../../../wire/routes";
import type { Fleet } from "./fleet-state";
import { PersonForm } from "./person-form";
import { TEXT } from "./texts";

export function Alarms({ robot, fleet }: { readonly robot: RobotSummary; readonly fleet: Fleet }) {
  const asking = useSignal("");
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const send = async (by: string): Promise<void> => {
    const outcome = await request("POST /api/fleet/robots/{robot}/acknowledge", {
      path: { robot: robot.name },
      body: { condition: asking.peek(), by },
    });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) return;
    asking.value = "";
    fleet.retry();
  };
  if (robot.alarms.length === 0) return <p class="dim">{TEXT.noAlarm}</p>;
  return (
    <>
      <ul class="fleet-alarms">
        {robot.alarms.map((alarm) => (
          <Row
            key={`${alarm.condition} ${alarm.name} ${alarm.device}`}
            alarm={alarm}
            robot={robot}
            ask={() => (asking.value = alarm.condition)}
          />
        ))}
      </ul>
      {asking.value !== "" && <PersonForm title={TEXT.acknowledge} send={send} cancel={() => (asking.value = "")} />}
      {problem.value && <ProblemNote problem={problem.value} />}
    </>
  );
}

interface RowProps {
  readonly alarm: RobotAlarm;
  readonly robot: RobotSummary;
  readonly ask: () => void;
}

function Row({ alarm: { name, level, state, device, condition, acknowledged_by: by }, robot, ask }: RowProps) {
  const of = robot.devices.find(({ id }) => id === device);
  return (
    <li>
      <span class={`dot ${state === "acknowledged" ? "off" : level === "error" ? "bad" : "warn"}`} />
      <span>
        {name} <span class="dim">{of && TEXT.alarmOf(of.name || of.product)}</span>
      </span>
      {condition !== "" && state === "raised" ? (
        <Button
          changes
          look="small edge"
          words={TEXT.acknowledge}
          onClick={ask}
          aria-label={TEXT.acknowledgeAlarm(name)}
        />
      ) : (
        <span class="mid">{by === "" ? TEXT.alarmState(state) : TEXT.acknowledgedBy(by)}</span>
      )}
    </li>
  );
}
