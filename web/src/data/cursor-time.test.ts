import { describe, expect, it } from "vitest";
import type { View } from "./view";
import { readingAt } from "./cursor-time";

const live: View = { device: "1", live: true, end: 0, span: 20, timeBase: "device" };
const paused: View = { ...live, live: false, end: 100 };

describe("readingAt", () => {
  it("reads the newest sample while live, also under the pointer", () => {
    expect(readingAt(live, undefined, 50)).toEqual({
      time: Number.POSITIVE_INFINITY,
      word: "now",
      from: 30,
      to: 50,
      base: "device",
      isOffScreen: false,
    });
    expect(readingAt(live, { kind: "pointer", fraction: 0.5 }, 50).word).toBe("now");
  });
  it("follows the pointer when paused, and a pinned cursor always", () => {
    expect(readingAt(paused, { kind: "pointer", fraction: 0.25 }, 500)).toMatchObject({
      time: 85,
      word: "cursor",
      to: 100,
    });
    expect(readingAt(live, { kind: "pinned", time: 42 }, 50)).toMatchObject({ time: 42, word: "cursor" });
  });
  it("says when the cursor is beside the window, and takes figures between both cursors", () => {
    expect(readingAt(paused, { kind: "pinned", time: 79 }, 500).isOffScreen).toBe(true);
    expect(readingAt(paused, { kind: "pinned", time: 90 }, 500, 60)).toMatchObject({
      ...{ time: 90, from: 60, to: 90, isOffScreen: false },
    });
  });
  it("reads the right edge when paused without a cursor", () => {
    expect(readingAt(paused, undefined, 500)).toMatchObject({ time: 100, word: "paused" });
  });
});
