/** Texts of the traffic log. */
import type { Value } from "../../wire/texts";

export const TEXT = {
  bothDirections: "both ways",
  filter: "Filter",
  sendHex: "Send hex",
  filterLabel: "Filter entries",
  filterPlaceholder: "Name, bytes or text",
  direction: "Direction",
  both: "Both",
  received: "Received",
  earlier: "Earlier",
  noFilterMatch: "No entries match the filter.",
  noTraffic: "Nothing has been sent to this device yet.",
  sentPrefix: "sent ",
  receivedPrefix: "received ",
  bytes: "bytes",
  sendAgain: "Send again",
  confirmSendAgain: (name: Value) => `Send ${name} again?`,
  confirmSendBytes: "Send these bytes?",
  bytesToSend: "Bytes to send (hex)",
  bytesPlaceholder: "FA FF 30 00 D1",
  sentUnchanged: "Sent unchanged, without a checksum added. What is known of the bytes is named before they are sent.",
};
