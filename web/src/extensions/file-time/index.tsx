/**
 * Time of a file or a stream: the clocks of an open recording or a live device, hidden until a person shows the panel or follows a figure
 * of loss or jitter; and the dialog of tables, which comes by itself where a table can be read in more than one way.
 */
import { effect } from "@preact/signals";
import { registerExtension } from "../../extension/extension";
import type { DeviceActionProps, App } from "../../page/context";
import { route } from "../../page/route";
import { Button } from "../../ui/controls/button";
import { late } from "../../ui/dom/late";
import { latePanel } from "../../ui/dom/late-panel";
import { linkFigures } from "./figure-links";
import "./layers.css";
import { TEXT } from "./texts";

/** Links figures to the clocks, and starts asking about tables once the page of recordings is shown. */
function start(app: App): void {
  linkFigures(app);
  const stop = effect(() => {
    if (route.value.page !== "recordings") return;
    queueMicrotask(() => stop());
    void import("./ask").then(({ followTables }) => followTables(app));
  });
}

function TimeButton({ app, device }: DeviceActionProps) {
  if (device.status !== "live") return null;
  return (
    <Button
      look="small"
      words={TEXT.streamButton}
      title={TEXT.streamHint}
      onClick={() => (app.overlay.value = "file-time/clocks")}
    />
  );
}

registerExtension({
  name: "file-time",
  start,
  views: [{ slot: "deviceActions", order: 12, View: TimeButton }],
  dialogs: [
    {
      overlay: "file-time/reading",
      Recording: late(async () => (await import("./reading-dialog")).RecordingReading),
    },
    {
      overlay: "file-time/clocks",
      Live: late(async () => (await import("./clocks-dialog")).StreamDialog),
      Recording: late(async () => (await import("./clocks-dialog")).FileDialog),
    },
  ],
  panels: [
    {
      id: "file-time",
      title: TEXT.title,
      where: "below",
      order: 52,
      optional: true,
      applies: ({ recording }) => recording !== undefined,
      mount: (host, deps) => latePanel(async () => (await import("./panel")).mountClocks.bind(undefined, host, deps)),
    },
    {
      id: "stream-time",
      title: TEXT.stream,
      where: "below",
      order: 52,
      optional: true,
      applies: ({ recording }) => recording === undefined,
      mount: (host, deps) => latePanel(async () => (await import("./stream")).mountStream.bind(undefined, host, deps)),
    },
  ],
});
