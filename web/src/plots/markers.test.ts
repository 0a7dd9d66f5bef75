import { expect, it } from "vitest";
import type { EventInfo } from "../wire/types";
import { eventInfo } from "../testing/fixtures";
import { markersIn, placed } from "./markers";
import { timeWindow } from "./time-window";

const event = (kind: EventInfo["kind"], time: number, text: string, device = ""): EventInfo =>
  eventInfo({ time, device, kind, text });

it("markers and notes of all devices and of this one are on its plots", () => {
  const events = [
    event("marker", 5, "Marker"),
    event("gap", 6, ""),
    event("marker", 7, "kerb", "1"),
    event("marker", 8, "else", "2"),
  ];
  expect(markersIn(events, "1")).toEqual([
    { time: 5, text: "" },
    { time: 7, text: "kerb" },
  ]);
});

it("those in the window are placed in order, with room up to the next", () => {
  const w = timeWindow({ device: "1", live: false, end: 20, span: 20, timeBase: "device" }, 20, 100, 400, 1);
  const found = placed(
    [
      { time: 15, text: "b" },
      { time: 10, text: "a" },
      { time: 30, text: "c" },
    ],
    w,
  );
  expect(found.map(({ x, text }) => [x, text])).toEqual([
    [300, "a"],
    [400, "b"],
  ]);
  expect(found[0]!.room).toBe(84);
});
