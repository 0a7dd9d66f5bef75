/** Choices on a table: what the server gets, and the words of the dialog. */
import { expect, test } from "vitest";
import type { PreviewColumn, TablePreview } from "../../wire/routes";
import { groupsOf } from "./reading-dialog";
import {
  previewCell,
  choiceOf,
  COUNT_ROWS,
  decimalsAt,
  samplingWords,
  readingOf,
  timeChoices,
  unitOption,
  withColumn,
  withTimes,
} from "./reading";
import { addressWithoutTimes } from "./reopen";

const column = (number: number, heading: string, more: Partial<PreviewColumn> = {}): PreviewColumn => ({
  number,
  heading,
  name: heading,
  unit: "",
  group: "",
  axis: "",
  role: "value",
  ...more,
});

const COLUMNS = [
  column(1, "t", { role: "time" }),
  column(2, "gz", { group: "g", axis: "z" }),
  column(3, "gx", { group: "g", axis: "x" }),
  column(4, ""),
  column(5, "a"),
  column(6, "a", { role: "left out" }),
];

const TABLE: TablePreview = {
  separator: ",",
  decimal: ".",
  skipped: 1,
  columns: COLUMNS,
  clocks: { t: "t" },
  clock: "t",
  time_column: "t",
  units: [],
  unit: "",
  rate: null,
  epoch: "",
  sure: "",
  sentences: [],
  times: [],
  rows: [],
  about: "unit",
  problem: "",
  hint: "",
  heading: [],
  packet_stamp: "",
};

test("another column of times has no unit and no rate of the one before", () => {
  const reading = readingOf({ time_column: "t", unit: "ms", date_order: "dmy", rate: 50 });
  expect(withTimes(reading, "gx")).toEqual({ ...readingOf({}), time_column: "gx" });
  expect(withTimes(reading, COUNT_ROWS).rate).toBe(50);
  expect(["s", "µs"].map(unitOption)).toEqual(["s", "us"]);
});

test("a column gets a name and a unit, or is left out", () => {
  const [, gz] = COLUMNS as [PreviewColumn, PreviewColumn];
  const named = withColumn(readingOf({}), gz, { name: " gyr z ", unit: "rad/s", isRead: true });
  expect(named.columns).toEqual({ "2": "gyr z (rad/s)" });
  expect(withColumn(named, gz, { name: "gyr z", unit: "", isRead: false }).columns).toEqual({ "2": "" });
  expect(withColumn(named, gz, { name: " ", unit: "", isRead: true }).columns).toEqual({});
  expect(choiceOf(column(6, "a", { role: "left out" })).isRead).toBe(false);
});

test("any column can be the times: by its heading, or by its number where that is not enough", () => {
  const choices = timeChoices(TABLE, { "3": "gyr x" });
  expect(choices).toEqual([
    ["t", "t"],
    ["gz", "gz"],
    ["3", "gx"],
    ["4", ""],
    ["5", "a"],
    ["6", "a"],
  ]);
});

test("columns of a vector stand together in the order of its axes", () => {
  const groups = groupsOf(COLUMNS).map(({ name, columns }) => [name, columns.map(([place]) => place)]);
  expect(groups).toEqual([
    ["", [0]],
    ["g", [2, 1]],
    ["", [3]],
    ["", [4]],
  ]);
});

test("numbers and rates are short", () => {
  expect([0.1 + 0.2, -9.5, null, "12:00"].map(previewCell)).toEqual(["0.3", "\u22129.5", "", "12:00"]);
  const slow = (seconds: string) => `one in ${seconds} s`;
  expect([100, 34_000, 1e6, 0.002].map((rate) => samplingWords(rate, slow))).toEqual([
    "100 Hz",
    "34 kHz",
    "1 MHz",
    "one in 500 s",
  ]);
  expect([null, 100, 1000].map(decimalsAt)).toEqual([3, 3, 6]);
});

test("a recording that is opened again keeps its view but for times", () => {
  const hash = "#/recordings/a?t0=1&t1=2&cursor=1&device=1&workspace=w";
  expect(addressWithoutTimes("a", hash)).toBe("#/recordings/a?device=1&workspace=w");
  expect(addressWithoutTimes("a", "#/recordings/a?t0=1&t1=2")).toBe("#/recordings/a");
  expect(addressWithoutTimes("b", hash)).toBe("#/recordings/b");
});
