/** The profile of a group, applied to its robots: the plan, then how it goes. It goes on when the dialog is closed. */
import { useSignal } from "@preact/signals";
import { Dialog } from "../../../ui/controls/dialog";
import { RolloutPlanForm } from "./rollout-plan";
import { RolloutProgress } from "./rollout-progress";
import { TEXT } from "./rollout-texts";
import "./rollouts.css";
import "./settings.css";

interface Props {
  readonly robot: string;
  readonly group: string;
  readonly device: string;
  /** A rollout that exists; undefined for a plan. */
  readonly rollout: number | undefined;
  readonly onClose: () => void;
}

export function RolloutDialog({ robot, group, device, rollout, onClose }: Props) {
  const shown = useSignal(rollout);
  return (
    <Dialog title={TEXT.title(group)} onClose={onClose}>
      <div class="rollout-dialog stacked">
        {shown.value === undefined ? (
          <RolloutPlanForm
            robot={robot}
            device={device}
            follow={(id) => {
              shown.value = id;
            }}
          />
        ) : (
          <RolloutProgress id={shown.value} />
        )}
      </div>
    </Dialog>
  );
}
