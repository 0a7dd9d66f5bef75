import { expect, it } from "vitest";
import { advance, begin, followed, type Playing } from "./playback";

const bounds = { first: 100, last: 200 };
const at = (part: Partial<Playing> = {}): Playing => ({
  head: 110,
  playing: true,
  speed: 2,
  loop: undefined,
  looping: false,
  ...part,
});

it("moves by the speed and stops at the end", () => {
  expect(advance(at(), 0.5, bounds).head).toBe(111);
  expect(advance(at({ head: 199.9 }), 1, bounds)).toMatchObject({ head: 200, playing: false });
  expect(advance(at({ playing: false }), 1, bounds).head).toBe(110);
  expect(begin(at({ head: 200, playing: false }), bounds)).toMatchObject({ head: 100, playing: true });
});

it("loops a range, also when entered from before, and carries the excess over", () => {
  const loop = { loop: [120, 130] as const, looping: true };
  expect(advance(at({ ...loop, head: 119 }), 1, bounds).head).toBe(121);
  expect(advance(at({ ...loop, head: 129 }), 1, bounds).head).toBe(121);
  expect(advance(at({ ...loop, head: 150 }), 1, bounds).head).toBe(152);
  expect(begin(at({ ...loop, head: 130 }), bounds).head).toBe(120);
});

it("keeps the playhead's position on screen", () => {
  expect(followed(120, 20, 110, 111)).toBe(121);
  expect(followed(120, 20, 50, 150)).toBeCloseTo(156);
});
