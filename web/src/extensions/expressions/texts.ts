/** Texts of computed signals. */
import type { Value } from "../../wire/texts";

export const TEXT = {
  newSignal: "New signal",
  editSignal: (name: Value) => `Edit ${name}`,
  expression: "Expression",
  expressionHint: "For example norm(Acceleration) - 1 g",
  name: "Name",
  causal: "Computed on the server from the past only: a filter has its delay.",
  save: "Save",
  saveAndPlot: "Save and plot",
  preview: (seconds: Value) => `Preview of the last ${seconds} s`,
  previewHint: "The preview shows the last 5 s.",
  edit: "Edit",
  remove: "Remove",
  made: (name: Value) => `${name} is computed, and on a new plot.`,
  edited: (name: Value) => `${name} has its new definition.`,
  gone: (name: Value) => `${name} is removed.`,
};
