/** Texts of one profile for several devices. */
import { count, type Value } from "../../texts/plural";

export const TEXT = {
  unknown: "The server was started again before the result was known.",
  dismissResults: "Dismiss results",
  rolloutOf: (name: Value, total: number) => `${name}: ${count(total, "value")}.`,
  applyProfile: "Apply this profile",
  applyTitleTo: (title: Value) => `Apply “${title}” to`,
  selected: "Selected",
  wouldChange: "Would change",
  result: "Result",
  applyToDevices: (devices: number) => `Apply to ${count(devices, "device")}`,
  rolloutSteps: "For each device: save a snapshot, write, verify.",
  notReadYetSentence: "Not read yet.",
  applyToDevice: (name: Value) => `Apply to ${name}`,
  thisDevice: "this device",
  comparing: "Comparing…",
  readDevice: (name: Value) => `Read ${name}`,
  alreadyApplied: "No change: the settings are the same.",
  nothingSelected: "No change: no difference is ticked above.",
  valueCount: (rows: number) => count(rows, "value"),
  rejectedLabel: "Rejected:",
  profile: (title: Value) => `Profile “${title}”`,
  confirmRollout: (title: Value, devices: number) => `Write “${title}” to ${count(devices, "device")}?`,
  writeProfile: "Write profile",
};
