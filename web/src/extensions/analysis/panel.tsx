/** An analysis as a panel: beside the plots, as long as it is wanted. Its code is fetched when it is first shown. */
import type { AnalysisPanel, AnalysisChoice } from "../../data/view";
import { selected } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import type { PanelDefinition } from "../../panels/registry";
import { late } from "../../ui/dom/late";
import { renderedPanel } from "../../panels/panel-host";
import { TEXT } from "./texts";
import { LENGTHS, WINDOWS } from "./choice";
import { areChoices, choicesJson, registerPart } from "../../workspace/parts";
import { isObject, type Json, type JsonObject } from "../../data/json";

const AnalysisView = late(async () => (await import("./view")).AnalysisView);

interface Props {
  readonly deps: Deps;
  readonly only?: AnalysisPanel;
}

/** Of the selected device; another device starts over. */
function SelectedAnalysis({ deps, ...rest }: Props) {
  const { store, recording } = deps;
  const device = selected(deps)?.id;
  if (device === undefined) return null;
  const prefix = recording && store.devices.value.length > 1 ? `${device}/` : "";
  return (
    <AnalysisView
      key={device}
      deps={deps}
      source={recording?.id ?? device}
      title={selected(deps)?.name ?? ""}
      prefix={prefix}
      isLive={!recording}
      {...rest}
    />
  );
}

/** A panel of one analysis, or of all, one at a time. Hidden until a person shows it. */
export const analysisPanel = (id: string, only: AnalysisPanel | undefined, order: number): PanelDefinition => ({
  id,
  title: TEXT[only ?? "analysis"],
  where: "main",
  height: "higher",
  order,
  class: "analysis-panel",
  optional: true,
  isWide: true,
  mount: (host, deps) => renderedPanel(host, <SelectedAnalysis deps={deps} {...(only ? { only } : {})} />),
});

/* The part of a workspace with what the panels of one analysis each show: spectrum, spectrogram, Allan deviation. */

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
