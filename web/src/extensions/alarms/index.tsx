/** Alarms: conditions that the server watches, with their list, their form, and their marks on plots and devices. */
import { registerExtension, type Slots } from "../../extension/extension";
import type { DeviceActionProps, LiveDialogProps } from "../../page/context";
import type { RecordingDialogProps } from "../../pages/recordings/open-recording";
import { readingAt } from "../../data/cursor-time";
import { reading } from "../../panels/panel-context";
import { Button } from "../../ui/controls/button";
import { late } from "../../ui/dom/late";
import { alarmCondition, canAlarm } from "./condition";
import { followAlarms } from "./follow";
import { alarmList, openAlarm } from "./list";
import { mountAlarms } from "./panel";
import { alarmLayer } from "./plot-marks";
import { AlarmTags } from "./tags";
import { TEXT } from "./texts";
import { alarmCompanion, type Added, addAlarms, offeredIn, presentAlarms } from "./workspace";
import { useSignal } from "@preact/signals";
import type { CompanionProps } from "../../workspace/companions";

const AlarmDialog = late(async () => (await import("./dialog")).AlarmDialog);

/** Alarms of the workspace that the server does not have: added when a person says so, and said which. */
function OfferedAlarms({ session, deps, said }: CompanionProps) {
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
        <div class="stored-offer text-sm" role="status">
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

function DeviceTags({ app, device }: DeviceActionProps) {
  return <AlarmTags alarms={alarmList(app.store).value} device={device.id} />;
}

function AlarmWhen({ deps, row }: Slots["signalActions"]) {
  if (!canAlarm(row)) return null;
  const open = (): void => openAlarm(deps.open, { expression: alarmCondition(row, reading(deps)), device: row.device });
  return <Button changes look="edge" words={TEXT.alarmWhen} onClick={open} />;
}

function Live({ app, onClose }: LiveDialogProps) {
  return <AlarmDialog app={app} onClose={onClose} />;
}

function Recording({ recording: { app, deps, replay, said }, onClose }: RecordingDialogProps) {
  const over = {
    recording: replay.detail.info.id,
    deps,
    show: (time: number) => replay.viewState.actions.pinInView(time),
    onSaved: () => void (said.value = TEXT.isAdded),
  };
  return <AlarmDialog app={app} onClose={onClose} over={over} />;
}

registerExtension({
  name: "alarms",
  start: followAlarms,
  panels: [
    {
      id: "alarms",
      title: TEXT.alarms,
      where: "below",
      order: 25,
      applies: ({ recording }) => !recording,
      mount: mountAlarms,
    },
  ],
  dialogs: [{ overlay: "alarms/dialog", Live, Recording }],
  views: [
    { slot: "deviceRow", order: 10, View: DeviceTags },
    { slot: "signalActions", order: 10, View: AlarmWhen },
    { slot: "workspaceCompanions", order: 10, View: OfferedAlarms },
  ],
  plotMarks: [alarmLayer],
  seriesActions: [
    {
      title: TEXT.withAlarm,
      applies: ({ channel, column }) => canAlarm({ channel, columns: [column] }),
      run({ channel, column }, { store, viewState: { view, cursor }, open, now }) {
        const device = store.devices.peek().find(({ id }) => id === channel.info.device);
        const at = readingAt(view.peek(), cursor.peek(), now);
        openAlarm(open, { expression: alarmCondition({ channel, columns: [column] }, at), device });
      },
    },
  ],
  companions: [alarmCompanion],
});
