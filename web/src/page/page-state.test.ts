import { describe, expect, it } from "vitest";
import type { DeviceInfo, DeviceStatus } from "../wire/types";
import { DEVICE } from "../testing/synthetic";
import { isHeld, markOf, pageState, shortSource, showsPlots } from "./page-state";

const device = (status: DeviceStatus): DeviceInfo => ({
  ...{ ...DEVICE, name: "MTi", source: "sim:xbus", protocol: "xbus" },
  status,
});

describe("pageState", () => {
  it("distinguishes the states before and after the first sample", () => {
    expect(pageState(false, 0, undefined, false)).toBe("starting");
    expect(pageState(true, 0, undefined, false)).toBe("empty");
    expect(pageState(true, 1, device("connecting"), false)).toBe("connecting");
    expect(pageState(true, 1, device("connecting"), true)).toBe("lost");
    expect(pageState(true, 1, device("live"), false)).toBe("loading");
    expect(pageState(true, 1, device("idle"), false)).toBe("silent");
    expect(pageState(true, 1, device("live"), true)).toBe("live");
    expect(pageState(true, 1, device("lost"), true)).toBe("lost");
    expect(pageState(true, 1, device("lost"), false)).toBe("unreached");
    expect(pageState(true, 1, device("denied"), true)).toBe("denied");
  });
  it("never shows a held value as fresh", () => {
    for (const state of ["lost", "idle", "ended"] as const) expect(isHeld(state) && showsPlots(state)).toBe(true);
    expect(isHeld("live")).toBe(false);
  });
});

describe("texts of the sidebar", () => {
  it("marks by shape and word", () => {
    expect(markOf("live", 0)).toEqual({ dot: "live", word: "live" });
    expect(markOf("live", 2).dot).toBe("warn");
    expect(markOf("lost", 0).dot).toBe("bad");
  });
  it("shortens sources", () => {
    expect(shortSource("/dev/ttyUSB0")).toBe("ttyUSB0");
    expect(shortSource("serial:///dev/ttyUSB0?baud=921600")).toBe("ttyUSB0");
    expect(shortSource("/dev/pts/4")).toBe("pts/4");
    expect(shortSource("tcp://10.0.7.21:2000")).toBe("tcp 10.0.7.21:2000");
    expect(shortSource("sim:xbus?rate=400")).toBe("sim:xbus");
    expect(shortSource("udp://:34555")).toBe("udp :34555");
  });
});
