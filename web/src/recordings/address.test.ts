import { expect, it } from "vitest";
import { parse } from "../pages/route";
import { placeHref, readPlace } from "./address";

it("reads what it writes", () => {
  const place = { t0: 1.7e9 + 0.1234, t1: 1.7e9 + 9, cursor: 1.7e9 + 5, loop: [1.7e9 + 1, 1.7e9 + 2] as const, device: "1.102", base: "arrival" as const, hide: ["a,b.x", "Größe.1 %"], panels: ["p&q"] };
  const route = parse(placeHref("2026-11-21 yard/loop", place));
  expect(route?.recording).toBe("2026-11-21 yard/loop");
  expect(readPlace(route?.query ?? "")).toEqual(place);
});

it("leaves out what it does not understand, and opens the rest", () => {
  expect(readPlace("t0=5&t1=4&cursor=later&loop=1&base=moon&hide=%25E0%25A4%25A&x=1")).toEqual({ hide: [], panels: [] });
  expect(readPlace("cursor=7")).toEqual({ cursor: 7, hide: [], panels: [] });
  expect(placeHref("a", { hide: [], panels: [] })).toBe("#/recordings/a");
});
