import { expect, it } from "vitest";
import { type Judged, toneOf } from "./tones";

const LEVELS = ["", "warn", "bad"];
const STEPS = [0, 0.4, 0.89, 0.9, 1, 3.6, 4.9, 5, 16, 1000];

it.each<Judged>(["count", "share", "uncertainty", "lateness"])(
  "never marks a smaller %s more than a larger one",
  (kind) => {
    const levels = STEPS.map((value) => LEVELS.indexOf(toneOf(kind, value)));
    expect(levels).toEqual([...levels].sort());
    expect(toneOf(kind, 0)).toBe("");
    expect(levels.at(-1)).toBeGreaterThan(0);
  },
);

it("has no tone for what is not known", () => {
  expect([toneOf("uncertainty", undefined), toneOf("share", NaN)]).toEqual(["", ""]);
});
