import { expect, it } from "vitest";
import { Ring } from "../data/ring-buffer";
import type { Channel } from "../data/channels";
import { staleness } from "./values";

/** A channel with a sample every `step` seconds up to 100 s. */
function upTo(step: number): { readonly channel: Channel } {
  const ring = new Ring([{ dtype: "f8", period: 0, status: false }]);
  const times = Float64Array.from({ length: 20 }, (_, k) => 100 - (19 - k) * step);
  ring.take({
    channel: 1,
    n: 20,
    dropped: 0,
    sequence: 0,
    history: false,
    now: 0,
    arrival: times,
    time: times,
    columns: [times],
  });
  return { channel: { info: {} as Channel["info"], ring } };
}

it("the value of a stopped stream is not shown as current", () => {
  const now = { word: "now" } as const;
  expect(staleness(upTo(0.01), now, 101)).toBeUndefined();
  expect(staleness(upTo(0.01), now, 280)).toBe("3 min");
  expect(staleness(upTo(10), now, 130)).toBeUndefined(); // rare, and on time
  expect(staleness(upTo(10), now, 160)).toBe("60 s");
  expect(staleness(upTo(0.01), { word: "cursor" }, 280)).toBeUndefined(); // of another moment, which is shown
});
