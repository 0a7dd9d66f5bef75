/** Texts of the packet view. */
import { count } from "./plural";
import type { Value } from "../wire/texts";

export const TEXT = {
  // packet dialog
  packet: "Bytes",
  packetOf: (device: Value) => `Bytes of ${device}`,
  loading: "Reading the bytes…",
  previous: "Previous frame (←)",
  next: "Next frame (→)",
  neighbours: "Frames before and after",
  size: (bytes: number) => count(bytes, "byte"),
  arrivedAt: (time: Value) => `arrived ${time} UTC`,
  sentAt: (time: Value) => `sent ${time} UTC`,
  sampledAt: (time: Value) => `sample at ${time} UTC, device time`,
  after: (ms: Value) => `${ms} ms after the one before`,
  gap: (ms: Value) => `+${ms} ms`,
  kind: { frame: "", reject: "Rejected frame", foreign: "Bytes between frames", sent: "Sent to the device" },
  section: (source: Value) => `Described in ${source}.`,
  offset: "Offset",
  bytes: "Bytes",
  meaning: "Meaning",
  raw: "Raw value",
  copyHex: "Copy hex",
  showInPlot: "Show in plot",
  shownAs: "In the plot:",
  moreBytes: (bytes: number) => `and ${count(bytes, "more byte")}`,

  // ways to it
  rejectedBytes: "Show the bytes of the last rejected frame",
};
