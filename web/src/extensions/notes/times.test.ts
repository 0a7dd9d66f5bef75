import { describe, expect, it } from "vitest";
import { piecesOf, timeText } from "./panel";

const MIDNIGHT = Date.UTC(2026, 10, 21) / 1000;
const NOON = MIDNIGHT + 43_200;

describe("times in notes", () => {
  it("lead to moments and ranges, and leave the rest as it is", () => {
    expect(piecesOf("kerb [12:00:01.5], then [12:00:02 – 12:00:03.25] and [0.5 g]", NOON)).toEqual([
      { text: "kerb " },
      { text: "12:00:01.5", t0: NOON + 1.5 },
      { text: ", then " },
      { text: "12:00:02 – 12:00:03.25", t0: NOON + 2, t1: NOON + 3.25 },
      { text: " and [0.5 g]" },
    ]);
    expect(piecesOf("", NOON)).toEqual([]);
  });

  it("are on the next day after midnight, and of the day that is written", () => {
    const late = MIDNIGHT + 86_400 - 10;
    expect(piecesOf("[00:00:05]", late)).toEqual([{ text: "00:00:05", t0: late + 15 }]);
    expect(piecesOf("[23:59:55 - 00:00:05]", late)[0]).toMatchObject({ t0: late + 5, t1: late + 15 });
    expect(piecesOf("[2026-11-23 00:00:05]", late)[0]?.t0).toBe(MIDNIGHT + 2 * 86_400 + 5);
  });

  it("are written as they are read, with the day in a long recording", () => {
    expect(timeText(NOON + 1.5, undefined, 60)).toBe("[12:00:01.500]");
    expect(timeText(NOON + 3, NOON + 1, 60)).toBe("[12:00:01.000 – 12:00:03.000]");
    for (const span of [60, 100_000])
      expect(piecesOf(timeText(NOON + 1.25, NOON + 2.5, span), NOON)[0]).toMatchObject({
        t0: NOON + 1.25,
        t1: NOON + 2.5,
      });
  });

  it("that lie in the second of the beginning are of that day", () => {
    expect(piecesOf("[12:00:00]", NOON + 0.7)[0]?.t0).toBe(NOON);
  });
});
