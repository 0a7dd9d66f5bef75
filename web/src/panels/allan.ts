/** The Allan deviation of signals, as it grows while a device rests. Hidden until a person shows it. */
import { analysisPanel } from "../analysis/panel";
import { registerPanel } from "./registry";

registerPanel(analysisPanel("allan", "allan", 18));
