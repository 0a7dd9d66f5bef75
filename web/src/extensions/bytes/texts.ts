/** Texts of the panel with the frames of a device. */

export const TEXT = {
  title: "Bytes",
  hold: "Hold",
  follow: "Follow",
  holdHint: "Stop the list to read it, or follow the newest frames again",
  isHeld: "On hold. Follow shows the newest again.",
  newestFirst: "Newest first. A frame opens its bytes with their meaning.",
  newestFrames: "Newest frames",
  noFrames: "No frames yet.",
};
