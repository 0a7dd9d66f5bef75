import { expect, test } from "vitest";
import { headNews } from "./viewer-sync";

test("the first place is told, and a paused one only once", () => {
  const now = { t: 5, rate: 0, at: 1 };
  expect(headNews(undefined, now)).toEqual(now);
  expect(headNews(now, { ...now, at: 100 })).toBeUndefined();
});

test("a step while paused is told, at the pace of a person's hand", () => {
  const told = { t: 5, rate: 0, at: 1 };
  expect(headNews(told, { t: 5.01, rate: 0, at: 1.01 })).toBeUndefined();
  expect(headNews(told, { t: 5.01, rate: 0, at: 1.05 })).toEqual({ t: 5.01, rate: 0, at: 1.05 });
});

test("playing on is no news for a second, a seek is", () => {
  const told = { t: 5, rate: 2, at: 1 };
  expect(headNews(told, { t: 6, rate: 2, at: 1.5 })).toBeUndefined();
  expect(headNews(told, { t: 9, rate: 2, at: 1.5 })).toBeDefined();
  expect(headNews(told, { t: 7, rate: 2, at: 2 })).toBeDefined();
});

test("play, pause and another speed are told at once", () => {
  expect(headNews({ t: 5, rate: 0, at: 1 }, { t: 5, rate: 1, at: 1.001 })).toBeDefined();
});
