/** Calibration of a live device, with a coach. */
import { registerExtension } from "../../extension/extension";
import type { DeviceActionProps, LiveDialogProps } from "../../page/context";
import { Button } from "../../ui/controls/button";
import { late } from "../../ui/dom/late";
import { TEXT } from "./texts";

const CalibrationDialog = late(async () => (await import("./dialog")).CalibrationDialog);

function CalibrateButton({ app, device }: DeviceActionProps) {
  if (device.status !== "live") return null;
  return (
    <Button
      changes
      look="small"
      words={TEXT.calibrate}
      title={TEXT.open}
      onClick={() => (app.overlay.value = "calibration/dialog")}
    />
  );
}

const Live = ({ app, device, onClose }: LiveDialogProps) => (
  <CalibrationDialog device={device} jobs={app.store.jobs.value.get(device.id)} onClose={onClose} />
);

registerExtension({
  name: "calibration",
  views: [{ slot: "deviceActions", order: 10, View: CalibrateButton }],
  dialogs: [{ overlay: "calibration/dialog", Live }],
});
