/** Texts of stored workspaces. */
import { count } from "../../texts/plural";
import type { Value } from "../../wire/texts";

export const TEXT = {
  longest: (characters: number) => `A name has ${count(characters, "character")} at most.`,
  chooseWorkspace: "Open a workspace…",
  noneStored: "No workspace stored yet",
  save: "Save",
  newName: "Name of a new workspace",
  saveNew: "Save as new",
  openNewer: "Open the newer one",
  replaceWithMine: "Replace it with mine",
  more: "Export, import, default",
  exportFile: "Export",
  importFile: "Import…",
  remove: "Delete",
  openFamilyWith: (family: Value) => `Open devices of ${family} with this workspace`,
  saved: (name: Value) => `${name} is saved.`,
  deleted: (name: Value) => `${name} is deleted.`,
  isDefaultNow: (family: Value) => `Pages without a layout of their own now open devices of ${family} with it.`,
  workspace: "Stored workspace",
  opened: (name: Value) => `${name} is open.`,
};
