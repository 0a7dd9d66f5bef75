/** What of an analysis a person chooses, with its defaults. A panel's choice is part of the workspace, that of the dialog is its own. */
import { type ReadonlySignal, useComputed, useSignal } from "@preact/signals";
import type { ViewState } from "../../data/view-state";
import type { AnalysisChoice, AnalysisPanel } from "../../data/view";
import { inertialNames, type Name, type RangeName } from "./figures";

export const WINDOWS = ["hann", "hamming", "blackmanharris", "flattop", "boxcar"] as const;
/** Samples of a segment; 0: automatic. */
export const LENGTHS = [0, 64, 256, 1024, 4096, 16384, 65536] as const;

/** A choice with what is at its default. */
export interface WholeChoice
  extends Required<Omit<AnalysisChoice, "scale" | "frequencyAxis" | "motion" | "temperature">> {
  readonly range: RangeName;
  readonly scale: "amplitude" | "power";
  readonly frequencyAxis: "linear" | "log";
  readonly motion: "exclude" | "include";
  readonly temperature: "exclude" | "include";
}

/** @param names channels that can be analysed, the most wanted one first @param between range where two cursors are set */
export function wholeChoice(
  name: Name,
  choice: AnalysisChoice,
  names: readonly string[],
  between: boolean,
): WholeChoice {
  const isAllan = name === "allan";
  const defaults = {
    signals: isAllan ? inertialNames(names).join(", ") : (names[0] ?? ""), // noise is judged of all axes at once
    range: between ? "cursors" : isAllan ? "everything" : "window",
    window: "hann",
    length: 0,
    scale: "amplitude",
    frequencyAxis: "linear",
    motion: "exclude",
    temperature: "exclude",
  } as const;
  return { ...defaults, ...choice };
}

/** Values that are the default are not held, so that a workspace has only what a person changed. */
const DEFAULTS = {
  window: "hann",
  length: 0,
  scale: "amplitude",
  frequencyAxis: "linear",
  motion: "exclude",
  temperature: "exclude",
};

export type ChoiceChange = { readonly [name in keyof WholeChoice]?: WholeChoice[name] };

export interface ChoiceState {
  readonly choice: ReadonlySignal<AnalysisChoice>;
  readonly set: (part: ChoiceChange) => void;
}

/** @param panel whose choice it is; undefined: of the component that calls this */
export function useChoice({ analyses }: ViewState, panel: AnalysisPanel | undefined): ChoiceState {
  const own = useSignal<AnalysisChoice>({});
  const choice = useComputed(() => (panel ? (analyses.value[panel] ?? {}) : own.value));
  const set = (part: ChoiceChange): void => {
    const next = Object.fromEntries(
      Object.entries({ ...choice.peek(), ...part }).filter(
        ([name, value]) => DEFAULTS[name as keyof typeof DEFAULTS] !== value,
      ),
    ) as AnalysisChoice;
    if (!panel) own.value = next;
    else analyses.value = { ...analyses.peek(), [panel]: next };
  };
  return { choice, set };
}
