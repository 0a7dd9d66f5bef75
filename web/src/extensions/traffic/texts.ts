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
  sentUnchanged:
    "Sent unchanged, with no checksum added. The server reads them first: one valid message that only asks is sent at once; before " +
    "all others it says what they are, and asks you.",
};
