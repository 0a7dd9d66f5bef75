import { expect, it } from "vitest";
import { mistakeIn, momentOf, neighbour } from "./go-to";

const FROM = Date.UTC(2025, 9, 9, 8, 53, 20) / 1000;

it.each([
  ["-5 s", FROM - 5],
  ["−5", FROM - 5],
  ["+200 ms", FROM + 0.2],
  ["+ 1.5min", FROM + 90],
  ["-2h", FROM - 7200],
  ["08:53:21.25", FROM + 1.25],
  ["8:54", FROM + 40],
  ["2025-10-08 08:53:20 UTC", FROM - 86_400],
  ["2025-10-09T08:53:20Z", FROM],
  ["1760000000.5", 1_760_000_000.5],
])("%s is a moment", (text, moment) => {
  expect(momentOf(text, FROM)).toBeCloseTo(moment, 6);
});

it.each(["", "5", "norm(acc) > 3 g", "25:00", "08:60", "2025-13-40 08:00", "-5 kg", "x - 5 s"])(
  "%s is none",
  (text) => {
    expect(momentOf(text, FROM)).toBeUndefined();
  },
);

it("finds the neighbour of a time among others in any order, and not the time itself", () => {
  const times = [30, 10, 20];
  expect([neighbour(times, 20, true), neighbour(times, 20, false)]).toEqual([30, 10]);
  expect([neighbour(times, 30, true), neighbour(times, 10, false)]).toEqual([undefined, undefined]);
});

it("finds the word of a mistake", () => {
  const text = "norm(Speed) > 3 kg";
  expect(mistakeIn(text, "Signal Speed not found. (character 6)")).toEqual([5, 10]);
  expect(mistakeIn(text, "kg was not expected. (character 17)")).toEqual([16, 18]);
  expect(mistakeIn(text, "An operand is missing. (character 19)")).toEqual([18, 19]);
  expect(mistakeIn(text, "The server does not answer.")).toBeUndefined();
});
