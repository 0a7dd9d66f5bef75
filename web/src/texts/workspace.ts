/** Texts of workspaces. */
import type { Value } from "./plural";

export const TEXT = {
  notAWorkspace: "This is not a workspace of imuscope, so nothing was changed.",
  otherVersion: (given: Value, known: Value) =>
    `This workspace has version ${given}, and this page reads version ${known}, so nothing was changed.`,
  unknownPart: (key: Value) => `This page does not know the part “${key}” of the workspace, so it was left out.`,
  brokenPart: (key: Value) => `The part “${key}” of the workspace is damaged, so it was left out.`,
} as const;
