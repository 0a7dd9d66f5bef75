/** Texts of rollouts: the profile of a group, applied in waves. */
import { count } from "../../../texts/plural";
import type { Value } from "../../../wire/texts";

const groupWords = (group: string): string => (group === "" ? "the robots without a group" : `the group ${group}`);

export const TEXT = {
  open: "Apply to the group",
  show: "Show the rollout",
  title: (group: string) => `Apply the profile to ${groupWords(group)}`,
  comparing: "Comparing the robots…",
  differs: (n: number, product: Value, group: string) =>
    `${count(n, "device")} (${product}) of ${groupWords(group)} will be written to.`,
  nothing: (product: Value, group: string) => `No device (${product}) of ${groupWords(group)} can be written to now.`,
  origin: (robot: Value, by: Value, when: Value) => `Profile from ${robot}, by ${by}, ${when}.`,
  same: (n: number) => `${count(n, "device")} already as in the profile.`,
  settingTitle: "Setting",
  nowTitle: "Now",
  profileTitle: "Profile",
  nothingValue: "none",
  more: (n: number) => `and ${n} more`,
  leftOut: (n: number) => `${count(n, "device")} left out`,
  deviceOf: (robot: Value, device: Value) => `${robot}, ${device}`,
  waves: "Waves",
  wavesHint: "Devices in each wave, or a percentage of the rest; the last one is repeated.",
  sizes: (first: Value) => `Devices per wave: ${first}`,
  manySizes: (first: Value, n: number) => `Devices per wave: ${first}, … (${count(n, "wave")})`,
  watch: "Watch each for",
  watchUnit: "s",
  watchHint: "So long a device has to deliver at the rate of the profile before its settings are confirmed.",
  promise:
    "Each robot saves a snapshot first. A device that does not deliver is rolled back by its robot, with or without a line, and no further wave begins.",
  start: (n: number) => `Apply to ${count(n, "device")}`,
  stop: "Stop",
  stopHint: "Devices under way are finished; no other one begins.",
  stopping: "Stopping: devices under way are finished.",
  running: (id: Value, by: Value) => `Rollout ${id}, started by ${by}`,
  states: {
    running: "Running",
    done: "Done",
    failed: "Failed",
    stopped: "Stopped",
    interrupted: "Interrupted",
  },
  wave: (n: number, all: number) => `Wave ${n} of ${all}`,
  waitingFor: (wave: number) => `wave ${wave}`,
  doneOf: (n: number, all: number) => `${n} of ${count(all, "device")} done`,
  progress: "Devices done",
  deviceStates: {
    waiting: "waiting",
    applying: "being written to",
    watching: "being watched",
    confirming: "being confirmed",
    done: "done",
    failed: "failed",
    unknown: "unknown",
    left: "left out",
    "not-started": "not started",
  },
  last: (id: Value, by: Value, state: Value) => `Rollout ${id} by ${by}: ${state}`,
};
