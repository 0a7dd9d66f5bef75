/** Texts of the 3D scene. */
export const TEXT = {
  scene3d: "3D scene",
  closeScene: "Close the 3D scene",
  aScene: "a 3D scene",
  sceneHint: "Body, axes and track, drawn by viser",
  scene: "Scene",
  allDevicesSideBySide: "All devices, side by side",
  sceneOfRecording: "3D scene of the recording",
  sceneByViser: "3D scene, by viser",
  startingScene: "Starting the 3D scene…",
  sceneEnded: "The 3D scene has ended.",
  reopens: "It opens again once the server is back.",
  reopenScene: "Close the panel and open it again.",
};
