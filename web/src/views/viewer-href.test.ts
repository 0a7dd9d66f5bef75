import { expect, test } from "vitest";
import { viewerHref } from "./viewer-href";

test("a whole recording is named and nothing else", () => {
  expect(viewerHref("a drive&more", undefined, "dark")).toBe("/rerun/?recording=a+drive%26more&theme=dark");
});

test("a stretch keeps its microseconds", () => {
  expect(viewerHref("a", [1760000000.123456, 1760000001.5], "light")).toBe("/rerun/?recording=a&t0=1760000000.123456&t1=1760000001.5&theme=light");
});
