/** The histogram of one or several signals. Hidden until a person shows it. */
import { TEXT } from "../texts/histogram";
import { latePanel } from "../ui/late-panel";
import { registerPanel } from "./registry";

registerPanel({
  id: "histogram",
  title: TEXT.title,
  where: "main",
  height: "high",
  order: 24,
  class: "histogram",
  optional: true,
  mount: (host, deps) =>
    latePanel(async () => (await import("../histogram/panel")).mountHistogram.bind(undefined, host, deps)),
});
