/** Texts of workspaces. */
import type { Value } from "./plural";

export const TEXT = {
  arrange: "Arrange panels",
  arrangeHint: "Arrange panels (W)",
  areas: { main: "Middle", side: "Side column", below: "Side column, lower part", hidden: "Hidden" },
  places: { main: "Middle", side: "Side", below: "Lower", hidden: "Hide" },
  placeOf: (panel: Value) => `Place of ${panel}`,
  moveUp: (panel: Value) => `Move ${panel} up`,
  moveDown: (panel: Value) => `Move ${panel} down`,
  maximise: (panel: Value) => `Maximize ${panel}`,
  doubleClickToMaximise: "Double-click to maximize (X)",
  restore: "Restore panel",
  show: "Show",
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
