/** Sharing the port of a device with other programs. */
import { registerExtension } from "../../extension/extension";
import type { DeviceActionProps, LiveDialogProps } from "../../page/context";

import { Button } from "../../ui/controls/button";
import { late } from "../../ui/dom/late";
import { linkNamed } from "../../wire/capabilities";
import { TEXT } from "./texts";

const SharePort = late(async () => (await import("./dialog")).SharePort);

function SharePortButton({ app, device }: DeviceActionProps) {
  if (device.parent !== "" || linkNamed(device.link)?.shareable !== true) return null;
  return <Button look="small" words={TEXT.sharePort} onClick={() => (app.overlay.value = "shares/dialog")} />;
}

const Live = (properties: LiveDialogProps) => <SharePort {...properties} />;

registerExtension({
  name: "shares",
  views: [{ slot: "deviceActions", order: 5, View: SharePortButton }],
  dialogs: [{ overlay: "shares/dialog", Live }],
});
