/** The spectrum of signals, of the range of the plots or between both cursors. Hidden until a person shows it. */
import { analysisPanel } from "../analysis/panel";
import { registerPanel } from "./registry";

registerPanel(analysisPanel("spectrum", "psd", 16));
