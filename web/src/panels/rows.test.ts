import { expect, it } from "vitest";
import { Ring } from "../data/ring-buffer";
import type { ChannelInfo } from "../wire/types";
import { columnInfo } from "../testing/fixtures";
import { cellsOf } from "./rows";

it('"Signals 6 rows" are the rows of one time, in words and numbers', () => {
  const column = (name: string, choices = {}) => columnInfo({ name, dtype: "f8", choices, decimals: 1 });
  const info = { columns: [column("gnss", { "0": "GPS" }), column("cno")] } as unknown as ChannelInfo;
  const ring = new Ring(info.columns.map(({ dtype }) => ({ dtype, period: 0, status: false })));
  const times = Float64Array.from([1, 1, 2, 2, 2]);
  ring.take({
    channel: 1,
    n: 5,
    dropped: 0,
    sequence: 0,
    history: false,
    now: 0,
    arrival: times,
    time: times,
    columns: [Float64Array.from([0, 0, 0, 1, 0]), Float64Array.from([1, 2, 30, 40.5, 50])],
  });
  expect(cellsOf({ info, ring }, 4)).toEqual([
    ["GPS", "30.0"],
    ["1.0", "40.5"],
    ["GPS", "50.0"],
  ]);
  expect(cellsOf({ info, ring }, 1)).toHaveLength(2);
  expect(cellsOf({ info, ring }, -1)).toEqual([]);
});
