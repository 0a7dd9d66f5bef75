// @vitest-environment happy-dom
import { expect, it } from "vitest";
import { href, parse, route, startRoute } from "./route";

it("reads what it writes, for any names", () => {
  const place = "AlignmentRotation.RotSensor";
  expect(parse(href("configure", "1.102", place))).toEqual({
    page: "configure",
    device: "1.102",
    place,
    more: undefined,
  });
  expect(parse(href("configure", "1", "compare", "a/b %"))).toMatchObject({ place: "compare", more: "a/b %" });
  expect(href("configure", "1", undefined, "x")).toBe("#/configure/1");
  expect(parse(href("live"))).toMatchObject({ page: "live" });
});

it("ignores other hashes", () => {
  expect(parse("#plots")).toBeUndefined();
  expect(parse("#/nowhere/1")?.page).toBe("live");
  expect(parse("")?.page).toBe("live");
  expect(parse("#/configure/%")?.device).toBe("%");
});

it("opens a recording where its link says", () => {
  expect(parse(href("recordings"))).toMatchObject({ page: "recordings", recording: undefined });
  expect(parse(`${href("recordings", "a/b ?")}?t0=1.5&cursor=2`)).toMatchObject({
    page: "recordings",
    recording: "a/b ?",
    query: "t0=1.5&cursor=2",
  });
});

it("a link to Live carries the view; a plain one does not change it", () => {
  expect(parse("#/?device=2&span=5")).toMatchObject({ page: "live", query: "device=2&span=5" });
  expect(parse("#/")?.query).toBeUndefined();
});

/** Regression: an address typed without "#" opened Live. */
it("a page that is named in the path is opened", () => {
  history.replaceState(null, "", "/configure");
  startRoute();
  expect(route.value.page).toBe("configure");
  expect(location.hash).toBe("#/configure");
  history.replaceState(null, "", "/");
  startRoute();
  expect(route.value.page).toBe("live");
});
