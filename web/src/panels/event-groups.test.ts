import { expect, it } from "vitest";
import type { EventInfo } from "../wire/types";
import { eventInfo } from "../testing/fixtures";
import { eventGroups } from "./event-groups";

let seq = 0;
const event = (time: number, kind: EventInfo["kind"], text: string, more: Partial<EventInfo> = {}): EventInfo =>
  eventInfo({ seq: seq++, time, kind, text, ...more });
const gap = (time: number, samples = 1, more: Partial<EventInfo> = {}): EventInfo =>
  event(time, "gap", `${samples} lost (5 ms): in the cable.`, {
    level: "error",
    samples,
    t0: time - 0.01,
    t1: time,
    data: { by: "link" },
    ...more,
  });

it("a status event is not displaced by hundreds of losses", () => {
  const events = [...Array.from({ length: 300 }, (_, k) => gap(100 + k / 10)), event(131, "link", "ttyUSB0 is back.")];
  const groups = eventGroups([event(90, "device", "It said who it is."), ...events, gap(131.5)], "all", 25);
  expect(groups.map(({ kind, count }) => [kind, count])).toEqual([
    ["gap", 301],
    ["link", 1],
    ["device", 1],
  ]);
  expect(groups[0]).toMatchObject({
    text: "301 gaps, 301 samples lost: in the cable.",
    from: 100,
    to: 131.5,
    t0: 131.49,
    t1: 131.5,
    level: "error",
  });
});

it("a sum counts the gaps that it sums up", () => {
  expect(eventGroups([gap(1), gap(2, 40, { data: { gaps: 12, by: "link" } })], "all", 9)[0]).toMatchObject({
    count: 13,
  });
});

it("later events, of other devices or for other reasons, are listed separately", () => {
  const groups = eventGroups(
    [gap(0), gap(100), gap(101, 1, { device: "2" }), gap(102, 1, { data: { by: "device" } })],
    "all",
    9,
  );
  expect(groups).toHaveLength(4);
});

it("only selected kinds are listed, newest first, and each marker separately", () => {
  const events = [
    gap(1),
    event(2, "marker", "kerb"),
    event(3, "reply", "ReqDID", { data: { message: "DeviceID" } }),
    event(4, "marker", "kerb"),
  ];
  expect(eventGroups(events, "markers", 9).map(({ from }) => from)).toEqual([4, 2]);
  expect(eventGroups(events, "loss", 9)).toHaveLength(1);
  expect(eventGroups(events, "commands", 9).map(({ kind }) => kind)).toEqual(["reply"]);
  expect(eventGroups(events, "all", 2)).toHaveLength(2);
});
