import { expect, it } from "vitest";
import { clear } from "./canvas";

it("a frame never consists of clearing only", () => {
  const done: string[] = [];
  const context = new Proxy(
    {},
    { get: (_, name) => () => done.push(String(name)), set: () => true },
  ) as CanvasRenderingContext2D;
  clear(context, 100, 50);
  expect(done[0]).toBe("clearRect");
  expect(done.length).toBeGreaterThan(1);
});
