/** Texts of workspaces. */
import type { Value } from "../wire/texts";

export const TEXT = {
  sheet: "Workspace",
  sheetHint: "Workspace: arrange panels, open and save layouts (W)",
  areas: { main: "Middle", side: "Side column", below: "Side column, lower part", hidden: "Hidden" },
  places: { main: "Middle", side: "Side", below: "Lower", hidden: "Hide" },
  placeOf: (panel: Value) => `Place of ${panel}`,
  moveUp: (panel: Value) => `Move ${panel} up`,
  moveDown: (panel: Value) => `Move ${panel} down`,
  lower: (plot: Value) => `Make ${plot} lower`,
  taller: (plot: Value) => `Make ${plot} taller`,
  automatic: "automatic",
  automaticHeightOf: (shown: Value, plot: Value) => `${shown}: automatic height of ${plot}`,
  pixels: (px: Value) => `${px} px`,
  maximise: (panel: Value) => `Maximize ${panel}`,
  doubleClickToMaximise: "Double-click to maximize (X)",
  restore: "Restore panel",
  show: "Show",
  showPanel: (panel: Value) => `Show ${panel}`,
  undo: "Undo (Ctrl+Z)",
  redo: "Redo (Ctrl+Shift+Z)",
  done: "Done",
  defaultLayout: "Default layout",
  heightOf: (panel: Value) => `Height of ${panel}`,
  sideWidth: "Width of the side column",
  belowHeight: "Height of the lower panels",
  notAWorkspace: "This is not a workspace of imuscope, so nothing was changed.",
  otherVersion: (given: Value, known: Value) =>
    `This workspace has version ${given}, and this page reads version ${known}, so nothing was changed.`,
  unknownPart: (key: Value) => `This page does not know the part “${key}” of the workspace, so it was left out.`,
  brokenPart: (key: Value) => `The part “${key}” of the workspace is damaged, so it was left out.`,
} as const;
