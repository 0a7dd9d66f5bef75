/** Clocks of an open recording: unit, zero, drift, jitter and steps of each. Hidden until a person shows it. */
import { registerExtension } from "../../extension";
import { latePanel } from "../../ui/late-panel";
import { TEXT } from "./texts";

registerExtension({
  name: "file-time",
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
