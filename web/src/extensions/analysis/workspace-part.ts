/** The part of a workspace with what the panels of one analysis each show: spectrum, spectrogram, Allan deviation. */
import type { AnalysisChoice, AnalysisPanel } from "../../data/view";
import { LENGTHS, WINDOWS } from "./choice";
import { areChoices, choicesJson, registerPart } from "../../workspace/parts";
import { isObject, type Json, type JsonObject } from "../../data/json";

const PANELS: readonly AnalysisPanel[] = ["allan", "psd", "spectrogram"];
/** Longest list of signals, characters. */
const MAX_SIGNALS = 2000;

const CHECKS: Readonly<Record<keyof AnalysisChoice, (json: Json) => boolean>> = {
  signals: (json) => typeof json === "string" && json.length <= MAX_SIGNALS,
  range: (json) => json === "window" || json === "cursors" || json === "everything",
  window: (json) => WINDOWS.some((one) => one === json),
  length: (json) => LENGTHS.some((one) => one === json),
  scale: (json) => json === "power",
  frequencyAxis: (json) => json === "log",
  motion: (json) => json === "include",
  temperature: (json) => json === "include",
};

registerPart<JsonObject>({
  key: "analyses",
  read({ viewState: { analyses } }) {
    const chosen = PANELS.flatMap((panel) => {
      const choice = analyses.peek()[panel];
      return choice && Object.keys(choice).length > 0 ? [[panel, choicesJson(choice)] as const] : [];
    });
    return chosen.length > 0 ? Object.fromEntries(chosen) : undefined;
  },
  check(json) {
    if (!isObject(json) || Object.keys(json).length === 0) return undefined;
    const fits = Object.entries(json).every(
      ([panel, choice]) => PANELS.includes(panel as AnalysisPanel) && areChoices(choice, CHECKS),
    );
    return fits ? json : undefined;
  },
  write: ({ viewState: { analyses } }, json) => void (analyses.value = (json ?? {}) as typeof analyses.value),
});
