import { expect, it } from "vitest";
import { clear } from "./canvas";

it("clearing is never the only operation of a frame: a graphics processor would leave the cursor line on screen", () => {
  const done: string[] = [];
  const context = new Proxy(
    {},
    { get: (_, name) => () => done.push(String(name)), set: () => true },
  ) as CanvasRenderingContext2D;
  clear(context, 100, 50);
  expect(done[0]).toBe("clearRect");
  expect(done.length).toBeGreaterThan(1);
});
