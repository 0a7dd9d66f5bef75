/** Notes of a recording. Hidden until a person shows it. */
import { latePanel } from "../ui/late-panel";
import { TEXT } from "../texts/notes";
import { registerPanel } from "./registry";

registerPanel({
  id: "notes",
  title: TEXT.title,
  where: "below",
  order: 50,
  optional: true,
  mount: (host, deps) => latePanel(async () => (await import("../notes/panel")).mountNotes.bind(undefined, host, deps)),
});
