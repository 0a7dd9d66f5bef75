import { describe, expect, it } from "vitest";
import type { DeviceHealth } from "../wire/types";
import { RecentHealth, rateBars } from "./health-history";

const report = (time: number, more: Partial<DeviceHealth> = {}): DeviceHealth => ({
  device: "1",
  time,
  rate: 100,
  messages: [],
  gaps: 0,
  lost: 0,
  numbered: 0,
  rejects: 0,
  unclaimed: 0,
  bytes: 0,
  bytes_per_s: 0,
  capacity: null,
  jitter_ms: null,
  last_arrival: null,
  drift_ppm: null,
  drift_bound_ppm: null,
  time_presumes: "",
  uncertainty_ms: null,
  rejects_by: {},
  verified: null,
  unverified: null,
  dropped: 0,
  behind: { link: 0, decoding: 0, reason: "" },
  jitter_cause: null,
  ...more,
});

describe("Minute", () => {
  it("counts a report once", () => {
    const minute = new RecentHealth();
    minute.add(report(1));
    minute.add(report(1));
    expect(minute.of("1").length).toBe(1);
  });
});

describe("rateBars", () => {
  it("marks loss, and shows silence after the last report", () => {
    const minute = new RecentHealth();
    for (let t = 0.5; t <= 40; t += 0.5) minute.add(report(t, { lost: t >= 20 ? 3 : 0 }));
    const bars = rateBars(minute.of("1"), 60, 60);
    expect(bars[10]).toEqual({ height: 1, bad: false });
    expect(bars[20]).toEqual({ height: 1, bad: true });
    expect(bars[59]).toEqual({ height: 0, bad: true });
  });
  it("shows nothing before the first report", () => {
    const minute = new RecentHealth();
    for (let t = 50; t <= 60; t += 0.5) minute.add(report(t));
    expect(rateBars(minute.of("1"), 60, 60)[5]).toBeUndefined();
  });
});
