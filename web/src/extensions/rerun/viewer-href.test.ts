import { expect, test } from "vitest";
import { liveHref, viewerHref } from "./viewer-href";

test("a whole recording is named and nothing else", () => {
  expect(viewerHref("a drive&more", undefined, "dark")).toBe("/rerun/?recording=a+drive%26more&theme=dark");
});

test("a stretch keeps its microseconds", () => {
  expect(viewerHref("a", [1760000000.123456, 1760000001.5], "light")).toBe(
    "/rerun/?recording=a&t0=1760000000.123456&t1=1760000001.5&theme=light",
  );
});

test("a live view is that of a device, or of all", () => {
  expect(liveHref("usb 1", "dark")).toBe("/rerun/?live=usb+1&theme=dark");
  expect(liveHref(undefined, "light")).toBe("/rerun/?live=&theme=light");
});
