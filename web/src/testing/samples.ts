/** For tests: samples of a channel as they come, and rings that hold them. */
import { Ring } from "../data/ring-buffer";
import type { SampleFrame } from "../wire/codec";

/** Arrival is the time of the device; values become doubles unless they are an array of the wire already. */
export function sampleFrame(
  times: ArrayLike<number>,
  columns: readonly (readonly number[] | SampleFrame["columns"][number])[],
  part: Partial<SampleFrame> = {},
): SampleFrame {
  const time = Float64Array.from(times);
  return {
    ...{ channel: 1, sequence: 0, n: time.length, dropped: 0, history: false, now: 0, arrival: time, time },
    columns: columns.map((one) => (ArrayBuffer.isView(one) ? one : Float64Array.from(one))),
    ...part,
  };
}

/** A ring of doubles with these samples. */
export function ringOf(times: ArrayLike<number>, columns: Parameters<typeof sampleFrame>[1], period = 0): Ring {
  const ring = new Ring(columns.map(() => ({ dtype: "f8", period, status: false })));
  ring.take(sampleFrame(times, columns));
  return ring;
}
