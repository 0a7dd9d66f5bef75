/**
 * Time of a file: the clocks of an open recording, hidden until a person shows the panel, and the dialog of tables, which comes by itself
 * where a table can be read in more than one way.
 */
import { effect } from "@preact/signals";
import { registerExtension } from "../../extension";
import type { App } from "../../pages/app-state";
import { route } from "../../pages/route";
import { late } from "../../ui/late";
import { latePanel } from "../../ui/late-panel";
import { TEXT } from "./texts";

/** Starts asking about tables once the page of recordings is shown. */
function start(app: App): void {
  const stop = effect(() => {
    if (route.value.page !== "recordings") return;
    queueMicrotask(() => stop());
    void import("./ask").then(({ followTables }) => followTables(app));
  });
}

registerExtension({
  name: "file-time",
  start,
  dialogs: [
    {
      overlay: "file-time/reading",
      Recording: late(async () => (await import("./recording-dialog")).RecordingReading),
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
  ],
});
