import { expect, it } from "vitest";
import type { Behind } from "../wire/types";
import { PageDelays } from "./behind";
import { behindCause, behindHint, behindWords } from "../panels/behind-text";

const health = (behind: Partial<Behind>): { behind: Behind } => ({
  behind: { link: 0, decoding: 0, reason: "", ...behind },
});

it("tells nothing of half a second, and the sum of what is more", () => {
  const delays = new PageDelays();
  expect(delays.behind("1", undefined, 100).total).toBe(0);
  delays.note("1", 99.7, 99.8, 100);
  expect(delays.behind("1", health({ decoding: 0.1 }), 100).total).toBe(0);
  expect(delays.behind("1", health({ decoding: 0.3 }), 100).total).toBeCloseTo(0.6);
});

it("names the part in which most of it arises", () => {
  const delays = new PageDelays();
  expect(delays.behind("1", health({ link: 3, decoding: 1 }), 100).part).toBe("link");
  expect(delays.behind("1", health({ link: 1, decoding: 3 }), 100).part).toBe("decoding");
  delays.note("1", 90, 98, 99);
  expect(delays.behind("1", undefined, 99.5)).toMatchObject({ part: "connection", total: 9 });
  delays.note("1", 90, 91, 99);
  expect(delays.behind("1", undefined, 99.5)).toMatchObject({ part: "page", total: 9 });
  expect(delays.behind("2", undefined, 99.5).total).toBe(0);
});

it("forgets what was measured on frames of before", () => {
  const delays = new PageDelays();
  delays.note("1", 90, 98, 99);
  expect(delays.behind("1", undefined, 102).total).toBe(0);
});

it("measures nothing while the server's clock is unknown", () => {
  const delays = new PageDelays();
  delays.note("1", 90, NaN, 99);
  expect(delays.behind("1", undefined, 99).total).toBe(0);
});

it("says a reason only if it is known, and what helps", () => {
  const late = (behind: Partial<Behind>) => new PageDelays().behind("1", health(behind), 100);
  expect(behindCause(late({ decoding: 12, reason: "others" }))).toBe("the server's computer is busy");
  expect(behindCause(late({ decoding: 12 }))).toBe("decoding on the server is late");
  expect(behindWords(late({ link: 3, reason: "others" }))).toBe("Behind by 3.0 s: bytes arrive late on the link.");
  expect(behindHint(late({ decoding: 12 }))).toMatch(
    /^Link 0.* · decoding 12 s · .*Recordings and shared ports are served first/,
  );
});
