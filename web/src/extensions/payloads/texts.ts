/** Texts of payloads without a description. */
import type { Value } from "../../wire/texts";

export const TEXT = {
  newestPayload: (name: Value) => `Newest payload ${name}: offset, bytes, characters`,
  define: "Define payload…",
  payloadFacts: (rate: Value, total: Value, size: Value) => `${rate} /s · ${total} in total · ${size} B`,
  moreBytes: (rest: Value) => `… and ${rest} B more`,
  rawPayloads: "Raw payloads",
  undefinedPayloads: "payloads without a definition",

  // dialog
  definePayload: (name: Value) => `Define payload ${name}`,
  payloadFields: "Fields, in byte order",
  definitionLifetime: "Applies until imuscope stops. To make it permanent, save this text to a file and start with",
  fileOption: (name: Value) => `--${name} FILE`,
  useDefinition: "Use this definition",
  payloadBytes: "Frame",
  payloadBytesHint: "Show the frame of the newest payload",
};
