import { expect, it } from "vitest";
import type { ChannelInfo } from "../wire/types";
import { isEnough, nearOf, stretchFor } from "./time-range";

const bounds = { first: 0, last: 3600 };

it("requests a margin on both sides, within the ends, at screen resolution", () => {
  expect(stretchFor(100, 120, 1000, 0, bounds)).toEqual({ t0: 90, t1: 130, width: 2000 });
  expect(stretchFor(0, 3600, 1000, 0, bounds)).toEqual({ t0: 0, t1: 3600, width: 1000 });
  expect(stretchFor(100, 120, 1000, 50, bounds).t1).toBe(200);
  expect(stretchFor(3590, 3610, 1000, 0, bounds).t1).toBe(3610);
});

it("requests again only if the data are insufficient", () => {
  const held = { t0: 90, t1: 130, width: 2000 };
  const enough = (t0: number, t1: number, exact = false, speed = 0): boolean =>
    isEnough(held, exact, t0, t1, 1000, speed, bounds);
  expect(enough(100, 120)).toBe(true);
  expect(enough(109, 129)).toBe(true);
  expect(enough(115, 135)).toBe(false);
  expect(enough(109, 129, false, 5)).toBe(false); // soon played past its end
  expect(enough(105, 110)).toBe(false); // four times as fine
  expect(enough(105, 110, true)).toBe(true); // no finer data exist
  expect(isEnough(undefined, true, 0, 1, 10, 0, bounds)).toBe(false);
  expect(isEnough({ t0: 0, t1: 3600, width: 1000 }, false, -500, 4000, 1000, 0, bounds)).toBe(true);
});

it("requests a longer range for rare samples", () => {
  const channels = [1, 2, 3, 4].map((id) => ({ id }) as ChannelInfo);
  const near = nearOf(channels, { 1: 0.001, 2: 0.01, 3: 0.2 });
  expect(near.map(({ channels: ids }) => ids)).toEqual([[1, 2], [3], [4]]);
  expect(near[0]!.before).toBeLessThan(near[1]!.before);
});
