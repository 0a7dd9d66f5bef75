/** Texts of what cannot be read from the server. */

/** What a text is filled with. */
export type Value = string | number;

export const TEXT = {
  // socket worker
  invalidJson: "The server sent invalid JSON.",

  // codec
  headerCut: (left: Value, size: Value) => `${left} B left, but a header has ${size} B`,
  unknownOpcode: (opcode: Value) => `unknown opcode ${opcode}`,
  invalidLength: (size: Value) => `invalid frame length of ${size} B`,
  frameCut: (size: Value, left: Value) => `a frame of ${size} B exceeds the ${left} B left`,
  unknownChannel: (channel: Value) => `channel ${channel} was not advertised`,
  wrongColumnCount: (channel: Value, expected: Value, given: Value) =>
    `channel ${channel} has ${expected} columns, the frame has ${given}`,
  samplesCut: (n: Value, channel: Value, need: Value, size: Value) =>
    `${n} samples of channel ${channel} need ${need} B, the frame has ${size} B`,
  bigEndian: "this machine is big-endian; the wire format is little-endian",
  unreadableSamples: (at: Value, found: Value) => `Samples could not be read: at byte ${at}, ${found}.`,
};
