import { expect, test } from "vitest";
import { headNews } from "./viewer-sync";

test("the first position is reported, and a paused one only once", () => {
  const now = { t: 5, rate: 0, at: 1 };
  expect(headNews(undefined, now)).toEqual(now);
  expect(headNews(now, { ...now, at: 100 })).toBeUndefined();
});

test("steps while paused are reported at a limited rate", () => {
  const told = { t: 5, rate: 0, at: 1 };
  expect(headNews(told, { t: 5.01, rate: 0, at: 1.01 })).toBeUndefined();
  expect(headNews(told, { t: 5.01, rate: 0, at: 1.05 })).toEqual({ t: 5.01, rate: 0, at: 1.05 });
});

test("continued playback is reported once a second, a seek at once", () => {
  const told = { t: 5, rate: 2, at: 1 };
  expect(headNews(told, { t: 6, rate: 2, at: 1.5 })).toBeUndefined();
  expect(headNews(told, { t: 9, rate: 2, at: 1.5 })).toBeDefined();
  expect(headNews(told, { t: 7, rate: 2, at: 2 })).toBeDefined();
});

test("play, pause and a speed change are reported at once", () => {
  expect(headNews({ t: 5, rate: 0, at: 1 }, { t: 5, rate: 1, at: 1.001 })).toBeDefined();
});
