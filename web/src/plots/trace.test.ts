import { expect, it } from "vitest";
import type { Ring } from "../data/ring-buffer";
import { ringOf } from "../testing/samples";
import { PixelColumns } from "./pixel-columns";
import { isDense, traceSeries } from "./trace";
import { timeWindow } from "./time-window";

/** Lengths, in units of the quantity, of all lines drawn. */
class Pen {
  readonly lengths: number[] = [];
  #y = NaN;
  beginPath(): void {}
  stroke(): void {}
  moveTo(_x: number, y: number): void {
    this.#y = y;
  }
  lineTo(_x: number, y: number): void {
    this.lengths.push(Math.abs(y - this.#y));
    this.#y = y;
  }
}

/** A sawtooth 0 … 99, like a capture played in a loop; 100 samples/s. */
function saw(n: number): Ring {
  const at = Array.from({ length: n }, (_, i) => 1000 + i * 0.01);
  const ring = ringOf(at, [at.map((_, i) => i % 100)]);
  for (let i = 100; i < n; i += 100) ring.cut(at[i]!);
  return ring;
}

for (const width of [37, 200, 2000]) {
  it(`draws no stroke where a clock started again, also within a pixel (${width} px)`, () => {
    const columns = new PixelColumns(saw(1000), [0]);
    const w = timeWindow({ device: "1", live: false, end: 1010, span: 10, timeBase: "device" }, 1010, 0, width, 1);
    columns.prepare(w.g0, w.g1, w.dt, "device");
    expect(isDense(columns, w)).toBe(width < 1000);
    const pen = new Pen();
    traceSeries(pen as unknown as CanvasRenderingContext2D, columns, 0, w, { top: 0, hi: 100, k: 1 });
    expect(pen.lengths.length).toBeGreaterThan(30);
    expect(Math.max(...pen.lengths)).toBeLessThan(2 * Math.ceil(1000 / width) + 1);
  });
}
