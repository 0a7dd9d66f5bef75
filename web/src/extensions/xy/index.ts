/** The XY plot: one signal over another. Hidden until a person shows it. */
import { latePanel } from "../../ui/dom/late-panel";
import { TEXT } from "./texts";
import { registerExtension } from "../../extension/extension";
import "./workspace-part";

registerExtension({
  name: "xy",
  panels: [
    {
      id: "xy",
      title: TEXT.title,
      where: "main",
      height: "high",
      order: 22,
      class: "xy chart-panel",
      optional: true,
      mount: (host, deps) => latePanel(async () => (await import("./panel")).mountXy.bind(undefined, host, deps)),
    },
  ],
});
