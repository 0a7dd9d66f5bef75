/** The status lanes of a device, apart from the plots. Hidden until a person shows it: the plots have them until then. */
import { latePanel } from "../ui/dom/late-panel";
import { TEXT } from "../texts/plots";
import { registerPanel } from "./registry";

registerPanel({
  id: "lanes",
  title: TEXT.lanes,
  where: "main",
  order: 14,
  class: "lanes-panel",
  optional: true,
  isWide: true,
  mount: (host, deps) =>
    latePanel(async () => (await import("../plots/lanes-panel")).mountLanes.bind(undefined, host, deps)),
});
