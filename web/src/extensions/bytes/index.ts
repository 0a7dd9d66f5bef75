/** The frames of a device as they arrive. Hidden until a person shows it. */
import { latePanel } from "../../ui/dom/late-panel";
import { TEXT } from "./texts";
import { registerExtension } from "../../extension/extension";

registerExtension({
  name: "bytes",
  panels: [
    {
      id: "bytes",
      readsCursor: true,
      title: TEXT.title,
      where: "main",
      order: 26,
      class: "bytes-panel",
      optional: true,
      mount: (host, deps) => latePanel(async () => (await import("./panel")).mountBytes.bind(undefined, host, deps)),
    },
  ],
});
