/** Texts of the viewers of others: 3D scene, Rerun. */
import type { Value } from "./plural";

export const TEXT = {
  // rerun
  openInRerunHint: "Show the loop range or the entire recording in the Rerun viewer",
  openInRerun: "Open in Rerun",
  rerunViewer: "Rerun viewer",
  rerun: "Rerun",
  newTabHint: "Open in a new tab; the address can be shared",
  newTab: "New tab",
  fullScreen: "Full screen",
  fullScreenHint: "Full screen (Esc to leave)",
  closeRerun: "Close Rerun",

  // viser
  scene3d: "3D scene",
  closeScene: "Close the 3D scene",
  openScene: "Show in a 3D scene or in Rerun",
  otherViews: "Other views",
  gesturesAndKeys: "Gestures and keys",
  help: "Help",
  viewer: "Viewer",
  sceneHint: "Body, axes and track, drawn by viser",
  scene: "Scene",
  rerunHint: "Live body and plots in the Rerun viewer",
  allDevices: "All devices",
  allDevicesSideBySide: "All devices, side by side",
  allDevicesInTitle: "all devices",
  viewOf: (viewer: Value, device: Value) => `${viewer} of ${device}`,
  sceneOfRecording: "3D scene of the recording",
  sceneByViser: "3D scene, by viser",
  startingScene: "Starting the 3D scene…",
  sceneEnded: "The 3D scene has ended.",
  reopenScene: "Close the panel and open it again.",
};
