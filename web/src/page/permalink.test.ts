import { expect, it } from "vitest";
import { parse } from "./route";
import { placeHref, placeQuery, readPlace, seriesOf, takeSeries } from "./permalink";

it("reads what it writes", () => {
  const place = {
    t0: 1.7e9 + 0.1234,
    t1: 1.7e9 + 9,
    cursor: 1.7e9 + 5,
    loop: [1.7e9 + 1, 1.7e9 + 2] as const,
    speed: 4,
    device: "1.102",
    base: "arrival" as const,
    measure: 1.7e9 + 6,
    frame: "NED" as const,
    hide: ["a,b.x", "Größe.1 %"],
    show: ["a.norm"],
    panels: ["p&q"],
  };
  const route = parse(placeHref("2026-11-21 yard/loop", place));
  expect(route?.recording).toBe("2026-11-21 yard/loop");
  expect(readPlace(route?.query ?? "")).toEqual(place);
});

it("ignores unknown parts, and opens the rest", () => {
  expect(readPlace("t0=5&t1=4&cursor=later&loop=1&base=moon&hide=%25E0%25A4%25A&x=1")).toEqual({
    hide: [],
    show: [],
    panels: [],
  });
  expect(readPlace("cursor=7")).toEqual({ cursor: 7, hide: [], show: [], panels: [] });
  expect(placeHref("a", { hide: [], show: [], panels: [] })).toBe("#/recordings/a");
});

it("a live view has a length and no range", () => {
  const place = { span: 12.5, device: "2", base: "device" as const, hide: [], show: [], panels: [] };
  expect(placeQuery(place)).toBe("span=12.5&device=2");
  expect(readPlace("span=12.5&device=2")).toEqual({ span: 12.5, device: "2", hide: [], show: [], panels: [] });
  expect(readPlace("span=-1").span).toBeUndefined();
});

it("a shown norm is restored after a reload, and others stay hidden", () => {
  const before = new Set(["a.norm", "b.norm"]);
  const told = seriesOf(new Set(["a.norm", "a.x"]), before);
  expect(told).toEqual({ hide: ["a.x"], show: ["b.norm"] });
  const norms = new Set<string>(); // a newly opened page
  expect([...takeSeries(told, norms)]).toEqual(["a.x"]);
  expect(norms.has("b.norm")).toBe(true); // so it is not hidden when it first appears
  expect([...takeSeries({ hide: [], show: [] }, new Set(["a.norm"]))]).toEqual(["a.norm"]);
});
