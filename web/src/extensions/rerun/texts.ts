/** Texts of the Rerun viewer. */
export const TEXT = {
  openInRerunHint: "Show the loop range or the entire recording in the Rerun viewer",
  openInRerun: "Open in Rerun",
  rerunViewer: "Rerun viewer",
  rerun: "Rerun",
  closeRerun: "Close Rerun",
  rerunHint: "Live body and plots in the Rerun viewer",
  allDevices: "All devices",
};
