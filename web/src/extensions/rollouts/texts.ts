/** Texts of one profile for several devices. */
import { count } from "../../texts/plural";
import type { Value } from "../../wire/texts";

export const TEXT = {
  unknown: "The server was started again before the result was known.",
  dismissResults: "Dismiss results",
  rolloutOf: (name: Value, total: number, titles: Value) => `${name}: ${count(total, "value")} (${titles}).`,
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
  nothingPossible: "This product can have none of the values that differ.",
  tickedAbove: (total: number) => `${count(total, "value")}, ticked above`,
  tickedOf: (total: number, all: number) => `${total} of ${count(all, "value")} ticked`,
  change: (title: Value, from: Value, to: Value) => `${title}: ${from} → ${to}`,
  leftOut: (total: number) => `${count(total, "value")} left out`,
  rejectedLabel: "Rejected:",
  profile: (title: Value) => `Profile “${title}”`,
  confirmRollout: (title: Value, devices: number) => `Write “${title}” to ${count(devices, "device")}?`,
  writeProfile: "Write profile",
};
