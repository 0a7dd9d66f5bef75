/** The spectrogram of signals: their spectrum over time. Hidden until a person shows it. */
import { analysisPanel } from "../analysis/panel";
import { registerPanel } from "./registry";

registerPanel(analysisPanel("spectrogram", "spectrogram", 17));
