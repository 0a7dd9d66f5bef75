import { describe, expect, it } from "vitest";
import type { QueryAnswer, QueryWords } from "../../../wire/routes";
import { answerCsv, openingOf, shownCell, sorted } from "./answer";
import { countedBins, firstChoice, pictureOf, timeTicks } from "./chart-data";
import { completionsOfSql, placeOfMistake } from "./completion";

const column = (name: string) => ({ name, type: "text", doc: "" });
const words: QueryWords = {
  tables: [
    { name: "recordings", doc: "", columns: [column("recording"), column("robot"), column("started")] },
    { name: "minutes", doc: "", columns: [column("recording"), column("minute"), column("mean")] },
  ],
  signals: [
    { name: "Acceleration.x", unit: "m/s²" },
    { name: "RateOfTurn.x", unit: "°/s" },
  ],
  functions: [{ name: "median", form: "median(x)", doc: "Middle value" }],
};
const offered = (text: string): readonly string[] =>
  completionsOfSql(text.replace("|", ""), text.indexOf("|"), words).map(({ insert }) => insert);

describe("completion of a question", () => {
  it("offers tables after FROM and JOIN, before a letter is typed", () => {
    expect(offered("SELECT * FROM |")).toEqual(["recordings", "minutes"]);
    expect(offered("SELECT * FROM recordings JOIN mi|")).toEqual(["minutes"]);
  });

  it("offers columns of the tables that the question names", () => {
    expect(offered("SELECT m| FROM minutes").slice(0, 2)).toEqual(["minute", "mean"]);
    expect(offered("SELECT rob| FROM minutes")).not.toContain("robot");
    expect(offered("SELECT rob|")).toContain("robot");
  });

  it("offers columns of a table or its alias after a point", () => {
    expect(offered("SELECT r.| FROM recordings AS r JOIN minutes m")).toEqual(["recording", "robot", "started"]);
    expect(offered("SELECT m.me| FROM recordings r JOIN minutes m")).toEqual(["mean"]);
    expect(offered("SELECT minutes.mi| FROM minutes")).toEqual(["minute"]);
  });

  it("offers signals within samples('…'), and nothing in another text or a comment", () => {
    expect(offered("SELECT * FROM samples('|")).toEqual(["Acceleration.x", "RateOfTurn.x"]);
    expect(offered("SELECT * FROM samples('turn|")).toEqual(["RateOfTurn.x"]);
    expect(offered("SELECT 'rob|")).toEqual([]);
    expect(offered("SELECT 1 -- rob|")).toEqual([]);
  });

  it("offers functions and words of SQL", () => {
    expect(offered("SELECT medi|")).toContain("median()");
    expect(offered("SEL|")).toContain("SELECT");
  });

  it("replaces the word before the caret only", () => {
    const [one] = completionsOfSql("SELECT med FROM minutes", 10, words);
    expect(one).toMatchObject({ insert: "median()", from: 7, to: 10 });
  });

  it("finds the place that the server names", () => {
    expect(placeOfMistake("Line 2, column 3: no.", "SELECT\n  x")).toBe(9);
    expect(placeOfMistake("Too long.", "SELECT 1")).toBeUndefined();
  });
});

type Kinds = Readonly<Record<string, QueryAnswer["columns"][number]["kind"]>>;
const columnsOf = (kinds: Kinds) => Object.entries(kinds).map(([name, kind]) => ({ name, kind }));

describe("an answer", () => {
  it("is sorted by numbers or texts, those without a value last", () => {
    const rows = [[10], [null], [9]];
    expect(sorted(rows, { column: 0, isDescending: false })).toEqual([[9], [10], [null]]);
    expect(sorted(rows, { column: 0, isDescending: true })).toEqual([[10], [9], [null]]);
    expect(sorted([["otter-10"], ["otter-9"]], { column: 0, isDescending: false })).toEqual([
      ["otter-9"],
      ["otter-10"],
    ]);
    expect(sorted(rows, undefined)).toBe(rows);
  });

  it("becomes CSV that a spreadsheet reads", () => {
    const columns = columnsOf({ a: "text", b: "number" });
    expect(
      answerCsv({ columns }, [
        ['say "hi", you', 0.1],
        [null, -2],
      ]),
    ).toBe('a,b\n"say ""hi"", you",0.1\n,-2\n');
  });

  it("shows six digits of a number, and all of an integer", () => {
    expect([0.123456789, 1e-9, -3, null, true, [1]].map(shownCell)).toEqual([
      "0.123457",
      "1e-9",
      "-3",
      "",
      "true",
      "[1]",
    ]);
  });

  it("opens the recording of a row at the moment that names it best", () => {
    const columns = columnsOf({ started: "time", hardest_minute: "time", recording: "text" });
    const row = ["2026-01-01T00:00:00Z", "2026-01-01T00:05:00Z", "abc"];
    expect(openingOf({ columns }, row)).toEqual({
      recording: "abc",
      at: Date.UTC(2026, 0, 1, 0, 5) / 1000,
      isMinute: true,
    });
    expect(
      openingOf({ columns: columnsOf({ started: "time", recording: "text" }) }, [row[0], "abc"])?.at,
    ).toBeUndefined();
    expect(openingOf({ columns: columnsOf({ robot: "text" }) }, ["otter"])).toBeUndefined();
  });
});

describe("a picture of an answer", () => {
  const columns = columnsOf({
    serial: "text",
    signal: "text",
    temperature_c: "number",
    bias: "number",
    minutes: "integer",
  });
  const rows = [
    ["a", "Gyr.x", 20, 0.1, 3],
    ["a", "Gyr.y", 25, 0.2, 3],
    ["b", "Gyr.x", 30, null, 3],
  ];

  it("begins with a number over temperature, by group", () => {
    expect(firstChoice(columns, rows)).toEqual({ x: 2, y: 3, group: 1 });
    expect(firstChoice(columnsOf({ robot: "text" }), [])).toBeUndefined();
    const overTime = columnsOf({ lost: "integer", started: "time" });
    expect(firstChoice(overTime, [[1, "2026-01-01"]])).toEqual({ x: 1, y: 0, group: -1 });
  });

  it("leaves out rows without a value, and says how many", () => {
    const picture = pictureOf(columns, rows, { x: 2, y: 3, group: 1 });
    expect(picture?.left).toBe(1);
    expect(picture?.groups.map(({ name, colour }) => [name, colour])).toEqual([
      ["Gyr.x", "axis-x"],
      ["Gyr.y", "axis-y"],
    ]);
  });

  it("places texts side by side", () => {
    const picture = pictureOf(columns, rows, { x: 0, y: 4, group: -1 });
    expect(picture?.x).toMatchObject({ low: -0.5, high: 1.5 });
    expect(picture?.xTicks(10).map(({ text }) => text)).toEqual(["a", "b"]);
  });

  it("has ticks at round times in UTC", () => {
    const day = Date.UTC(2026, 0, 1) / 1000;
    const texts = (high: number) =>
      timeTicks({ kind: "linear", low: day, high: day + high }, 5).map(({ text }) => text);
    expect(texts(240)).toEqual(["2026-01-01", "00:01", "00:02", "00:03", "00:04"]);
    expect(texts(4 * 86_400)).toEqual(["2026-01-01", "2026-01-02", "2026-01-03", "2026-01-04", "2026-01-05"]);
  });

  it("counts every number once in bins", () => {
    const numbers = Array.from({ length: 1000 }, (_, k) => [k % 100, null]);
    const bins = countedBins(numbers, 0);
    expect(bins.reduce((sum, { count }) => sum + count, 0)).toBe(1000);
    expect([bins[0]?.low, bins.at(-1)?.high]).toEqual([0, 99]);
    expect(countedBins([[5], [5]], 0)).toEqual([{ low: 4.5, high: 5.5, count: 2 }]);
    expect(countedBins(numbers, 1)).toEqual([]);
  });
});
