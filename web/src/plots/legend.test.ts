import { expect, it } from "vitest";
import { Ring } from "../data/ring-buffer";
import type { Channel } from "../data/channels";
import { differenceOf } from "./legend";
import type { Series } from "../data/view";
import { CHANNELS, frameOf } from "../testing/synthetic";

/** A channel whose first column increases by 10° a second from `start`, at `times`, and wraps. */
function yawAt(times: readonly number[], start: number): Channel {
  const info = { ...CHANNELS[0]!, columns: CHANNELS[0]!.columns.map((column) => ({ ...column, period: 360 })) };
  const ring = new Ring(info.columns.map(({ dtype, period }) => ({ dtype, period, status: false })));
  const frame = frameOf(info, 0, Float64Array.from(times), false);
  const turned = Float32Array.from(times, (t) => ((start + 10 * t + 540) % 360) - 180);
  ring.take({ ...frame, columns: frame.columns.map(() => turned) });
  return { info, ring };
}
const seriesOf = (channel: Channel): Series => ({
  channel,
  column: 0,
  key: "",
  label: "",
  colour: "axis-x",
  dash: [],
  norm: false,
  decimals: 2,
});

it("measures from the first cursor to the second, the shorter way around the circle", () => {
  const series = seriesOf(yawAt([0, 1, 2, 3, 4], 175));
  expect(differenceOf(series, 0, 3, "device")).toBeCloseTo(30, 4);
  expect(differenceOf(series, 3, 0, "device")).toBeCloseTo(-30, 4);
});

it("measures between moments in separate blocks", () => {
  const drawn = yawAt([0, 4.5], 0);
  const [near, far] = [yawAt([0, 0.1, 0.2], 0), yawAt([4.4, 4.5, 4.6], 0)];
  const change = differenceOf(seriesOf(drawn), 0.1, 4.5, "device", (_, t) => (t === 4.5 ? far : near));
  expect(change).toBeCloseTo(44, 3);
});
