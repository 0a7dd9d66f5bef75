/** Notes of a recording. Hidden until a person shows it. */
import { latePanel } from "../../ui/dom/late-panel";
import { TEXT } from "./texts";
import { registerExtension } from "../../extension/extension";

registerExtension({
  name: "notes",
  panels: [
    {
      id: "notes",
      title: TEXT.title,
      where: "below",
      order: 50,
      optional: true,
      mount: (host, deps) => latePanel(async () => (await import("./panel")).mountNotes.bind(undefined, host, deps)),
    },
  ],
});
