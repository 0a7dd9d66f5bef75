import { expect, it } from "vitest";
import type { ChannelInfo } from "../wire/types";
import { columnInfo } from "../testing/fixtures";
import { ringOf } from "../testing/samples";
import { cellsOf } from "./rows";

it('"Signals 6 rows" are the rows of one time, in words and numbers', () => {
  const column = (name: string, choices = {}) => columnInfo({ name, dtype: "f8", choices, decimals: 1 });
  const info = { columns: [column("gnss", { "0": "GPS" }), column("cno")] } as unknown as ChannelInfo;
  const values = [
    [0, 0, 0, 1, 0],
    [1, 2, 30, 40.5, 50],
  ];
  const ring = ringOf([1, 1, 2, 2, 2], values);
  expect(cellsOf({ info, ring }, 4)).toEqual([
    ["GPS", "30.0"],
    ["1.0", "40.5"],
    ["GPS", "50.0"],
  ]);
  expect(cellsOf({ info, ring }, 1)).toHaveLength(2);
  expect(cellsOf({ info, ring }, -1)).toEqual([]);
});
