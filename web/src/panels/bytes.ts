/** The frames of a device as they arrive. Hidden until a person shows it. */
import { latePanel } from "../ui/late-panel";
import { TEXT } from "../texts/packets";
import { registerPanel } from "./registry";

registerPanel({
  id: "bytes",
  title: TEXT.packet,
  where: "main",
  order: 26,
  class: "bytes-panel",
  optional: true,
  mount: (host, deps) => latePanel(async () => (await import("../bytes/panel")).mountBytes.bind(undefined, host, deps)),
});
