import { expect, it } from "vitest";
import type { SampleFrame } from "../wire/codec";
import type { ChannelInfo } from "../wire/types";
import { sampleFrame } from "../testing/samples";
import { motionOf, worstOf } from "./overview-data";

const frame = (time: readonly number[], ...columns: readonly (readonly number[])[]): SampleFrame =>
  sampleFrame(time, columns, { history: true });

it("gives the variation of the most active column in every part", () => {
  const three = frame([0, 1, 5, 6, 9], [0, 1, 0, 4, 7], [0, 0, 0, 2, 7], [0, 99, 0, 0, 0]);
  expect([...motionOf(three, [0, 1], [0, 10], 4)]).toEqual([0.25, NaN, 1, 0]);
  expect([...motionOf(three, [1], [0, 10], 4)]).toEqual([0, NaN, 1, 0]);
});

it("keeps a fault of one sample, and a flag that should be set and is not", () => {
  const bits = [
    { name: "clip", low: 0, width: 1, severity: "warning", normal_set: false },
    { name: "self_test", low: 1, width: 1, severity: "error", normal_set: true },
  ];
  const info = { columns: [{ bits }] } as unknown as ChannelInfo;
  const worst = new Uint8Array(4);
  worstOf(info, frame([0, 3, 3, 6, 9], [2, 3, 2, 2, 0]), [0, 10], worst);
  expect([...worst]).toEqual([0, 1, 0, 2]);
});
