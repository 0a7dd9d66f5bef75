/** In the settings of a robot: applying the profile to its group, and the newest rollout of that profile. */
import type { RobotSummary, RolloutHead } from "../../../wire/routes";
import { Button } from "../../../ui/controls/button";
import { request } from "../../../requests/http";
import { useAnswer } from "../../../requests/use-answer";
import { TEXT } from "./rollout-texts";

/** Pause between two requests while a rollout is under way, ms. */
const ASK_MS = 3000;

interface Props {
  readonly robot: RobotSummary;
  readonly device: string;
  /** Opens a rollout, or a plan. */
  readonly open: (rollout: number | undefined) => void;
  /** Whether one is open: it may be another one afterwards. */
  readonly isShown: boolean;
}

export function GroupRollout({ robot, device, open, isShown }: Props) {
  const of = robot.devices.find(({ id }) => id === device);
  const { product = "", protocol = "" } = of ?? {};
  const newestOf = (all: readonly RolloutHead[] | undefined): RolloutHead | undefined =>
    all?.find((one) => one.group === robot.group && one.product === product && one.protocol === protocol);
  const asked = useAnswer(
    isShown ? "" : `${robot.group} ${product} ${protocol}`,
    () => request("GET /api/fleet/rollouts"),
    {
      everyMs: (all) => (newestOf(all)?.state === "running" ? ASK_MS : undefined),
    },
  );
  const found = newestOf(asked.answer);
  return (
    <div class="fleet-profile control-row">
      <Button changes look="edge" words={TEXT.open} onClick={() => open(undefined)} />
      {found && (
        <Button title={TEXT.show} onClick={() => open(found.id)}>
          <span class={`dot ${found.state === "failed" || found.state === "interrupted" ? "bad" : "off"}`} />{" "}
          {TEXT.last(found.id, found.by, TEXT.states[found.state].toLowerCase())}
        </Button>
      )}
    </div>
  );
}
