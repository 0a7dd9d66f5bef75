import { expect, it, vi } from "vitest";

const passes = (milliseconds: number) => new Promise((resolve) => setTimeout(resolve, milliseconds));

it("ends what a file of tests left running, also after its module was evaluated again", async () => {
  vi.resetModules();
  const { endTimers, watchTimers } = await import("./timers");
  let ticks = 0;
  const tick = () => (ticks += 1);
  setInterval(tick, 1);
  setTimeout(tick, 1);
  watchTimers(); // again, as the next file does
  setInterval(tick, 1);
  endTimers();
  await passes(20);
  expect(ticks).toBe(0);
});
