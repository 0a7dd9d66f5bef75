/** Texts about viewers of others in a frame; each has its own in its extension. */
import type { Value } from "../wire/texts";

export const TEXT = {
  newTabHint: "Open in a new tab; the address can be shared",
  newTab: "New tab",
  fullScreen: "Full screen",
  fullScreenHint: "Full screen (Esc to leave)",
  showIn: (viewers: Value) => `Show in ${viewers}`,
  orIn: " or in ",
  otherViews: "Other views",
  gesturesAndKeys: "Gestures and keys",
  help: "Help",
  viewer: "Viewer",
  allDevicesInTitle: "all devices",
  viewOf: (viewer: Value, device: Value) => `${viewer} of ${device}`,
};
