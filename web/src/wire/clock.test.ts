import { expect, it } from "vitest";
import { ServerClock } from "./clock";

it("uses the ping with the shortest round trip", () => {
  const clock = new ServerClock();
  expect(clock.estimate).toBeUndefined();
  clock.add(100, 160.4, 101); // a slow way back: 59.9 s
  clock.add(102, 162.012, 102.02); // 20 ms there and back: 60.002 s
  clock.add(103, 163.3, 103.5);
  expect(clock.estimate!.offset).toBeCloseTo(60.002, 6);
  expect(clock.estimate!.uncertainty).toBeCloseTo(0.01, 6);
});

it("drops old pings, because clocks drift", () => {
  const clock = new ServerClock();
  clock.add(0, 50, 0.001);
  for (let k = 1; k <= 16; k++) clock.add(k, k + 51, k + 0.1);
  expect(clock.estimate!.offset).toBeCloseTo(50.95, 6);
});

it("ignores a ping during which the local clock was set back", () => {
  const clock = new ServerClock();
  clock.add(100, 160, 99);
  clock.add(100, NaN, 101);
  expect(clock.estimate).toBeUndefined();
});
