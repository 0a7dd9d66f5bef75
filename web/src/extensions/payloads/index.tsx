/** Payloads without a definition: their bytes, and the form that defines them. */
import { registerExtension } from "../../extension/extension";
import type { LiveDialogProps } from "../../page/context";
import { late } from "../../ui/dom/late";
import { latePanel } from "../../ui/dom/late-panel";
import type { UnknownPayload } from "../../wire/types";
import { TEXT } from "./texts";

const PayloadDialog = late(async () => (await import("./dialog")).PayloadDialog);

function Live({ app, onClose }: LiveDialogProps) {
  const payload = app.subject.value as UnknownPayload | undefined;
  return payload ? <PayloadDialog app={app} payload={payload} onClose={onClose} /> : null;
}

registerExtension({
  name: "payloads",
  panels: [
    {
      id: "unknown-payloads",
      title: TEXT.rawPayloads,
      note: TEXT.undefinedPayloads,
      where: "below",
      order: 20,
      class: "raw-payloads",
      applies: (deps) => deps.store.unknownPayloads.value.some(({ device }) => device === deps.viewState.device.value),
      mount: (host, deps) =>
        latePanel(async () => (await import("./panel")).mountUnknownPayloads.bind(undefined, host, deps)),
    },
  ],
  dialogs: [{ overlay: "payloads/dialog", Live }],
});
