/**
 * When a figure is yellow or red: only from the value that is shown, and only where it wants a hand. The one place that says so for
 * devices and their links, so that a smaller trouble is never marked more than a larger one.
 */

export type FigureTone = "" | "warn" | "bad";

/** From these values on: a warning, a fault. Their units are those of the figures. */
const FROM = {
  /** Samples or frames within the last minute; here or at the device. */
  count: { warn: 1, bad: Infinity },
  /** Of the link's capacity: a fuller one has no room for a burst. */
  share: { warn: 0.9, bad: Infinity },
  /** Device time, ±ms: less certain times want a remedy. */
  uncertainty: { warn: 5, bad: Infinity },
  /** Of a sample that should have come: times the age after which a device is late. */
  lateness: { warn: Infinity, bad: 1 },
} as const;

export type Judged = keyof typeof FROM;

/** FigureTone of a value; none of an unknown one. */
export function toneOf(kind: Judged, value: number | undefined): FigureTone {
  const { warn, bad } = FROM[kind];
  if (value === undefined || Number.isNaN(value)) return "";
  if (value >= bad) return "bad";
  return value >= warn ? "warn" : "";
}
