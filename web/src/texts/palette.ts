/** Texts of the command palette. */
import type { Value } from "../wire/texts";

export const TEXT = {
  title: "Go to",
  search: "Search everything",
  hint: "Page, panel, device, signal, recording, setting",
  hidden: "hidden",
  nothingFound: (query: Value) => `Nothing matches “${query}”.`,
  kinds: {
    page: "page",
    action: "action",
    panel: "panel",
    device: "device",
    signal: "plot",
    setting: "setting",
    command: "command",
    recording: "recording",
  },
} as const;
