/** The histogram of one or several signals. Hidden until a person shows it. */
import { TEXT } from "./texts";
import { latePanel } from "../../ui/dom/late-panel";
import { registerExtension } from "../../extension/extension";
import "./workspace-part";

registerExtension({
  name: "histogram",
  panels: [
    {
      id: "histogram",
      title: TEXT.title,
      where: "main",
      height: "high",
      order: 24,
      class: "histogram chart-panel",
      optional: true,
      mount: (host, deps) =>
        latePanel(async () => (await import("./panel")).mountHistogram.bind(undefined, host, deps)),
    },
  ],
});
