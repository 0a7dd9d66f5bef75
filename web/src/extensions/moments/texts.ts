/** Texts of going to a moment. */
import { count } from "../../texts/plural";
import type { Value } from "../../wire/texts";

export const TEXT = {
  title: "Go to",
  label: "Time or condition",
  placeholder: "14:32:18, −5 s or norm(Acceleration) > 3 g",
  hint: "A time in UTC, a time relative to cursor A, or a condition over signals; Enter goes there, Shift Enter to the one before",
  go: "Go",
  kind: "Kind of place",
  kinds: {
    sample: "sample",
    event: "event",
    marker: "marker",
    gap: "gap",
    condition: "condition",
  },
  previous: "Previous (Shift N)",
  next: "Next (N)",
  close: "Close (Esc)",
  searching: "Searching…",
  at: (time: Value) => `${time} UTC`,
  trueFor: (time: Value, length: Value, more: number) =>
    `${time} UTC, true for ${length}; ${more === 0 ? "none" : count(more, "other")} beyond`,
  trueOnce: (time: Value, more: number) =>
    `${time} UTC, true at one sample; ${more === 0 ? "none" : count(more, "other")} beyond`,
  none: (kind: Value, forward: boolean) => `No ${kind} ${forward ? "after" : "before"} this.`,
  neverTrue: (forward: boolean) => `Not true ${forward ? "after" : "before"} this.`,
  outside: (first: Value, last: Value) => `The data are from ${first} to ${last} UTC.`,
  needsCondition: "Type a condition, for example norm(Acceleration) > 3 g.",
  keyGoTo: "Go to a time, or to where a condition is true",
  keyPlace: "Next or previous event, marker, gap or place of that condition",
};
