/** The alarms that a workspace brings, under the stored workspaces. */
import { Button } from "../../ui/controls/button";
import { useSignal } from "@preact/signals";
import type { CompanionProps } from "../../workspace/companions";
import { alarmList } from "./list";
import { TEXT } from "./texts";
import { type Added, addAlarms, offeredIn, presentAlarms } from "./workspace";

/** Alarms of the workspace that the server does not have: added when a person says so, and said which. */
export function OfferedAlarms({ session, deps, said }: CompanionProps) {
  const refused = useSignal<Added["refused"]>([]);
  const offered = offeredIn(session);
  const add = async (): Promise<void> => {
    const added = await addAlarms(offered.peek());
    refused.value = added.refused;
    offered.value = [];
    said.value = added.names.length > 0 ? TEXT.addedAlarms(added.names.length, added.names.join(", ")) : "";
    if (!deps.recording) alarmList(deps.store).value = await presentAlarms();
  };
  return (
    <>
      {offered.value.length > 0 && (
        <div class="stored-offer" role="status">
          <p>{TEXT.hasAlarms(offered.value.length, offered.value.map(({ name }) => name).join(", "))}</p>
          <div class="stored-row control-row">
            <Button changes look="edge" words={TEXT.addAlarms(offered.value.length)} onClick={() => void add()} />
            <Button look="edge" words={TEXT.notNow} onClick={() => (offered.value = [])} />
          </div>
        </div>
      )}
      {refused.value.map(({ definition, problem }) => (
        <p key={definition.name} class="problem" role="alert">
          {TEXT.refusedAlarm(definition.name, `${problem.message} ${problem.hint}`.trim())}
        </p>
      ))}
    </>
  );
}
