/** Sides of a comparison: the address, what a view gives, and which other side is proposed. */
import { describe, expect, it } from "vitest";
import { createViewState } from "../../../data/view-state";
import type { RecordingInfo } from "../../../wire/recording-types";
import type { DeviceInfo } from "../../../wire/types";
import { comparisonHref, isComparison, likelyOther, readComparison, requestedSide, sideOf } from "./sides";

const queryOf = (href: string): string => href.slice(href.indexOf("?") + 1);

describe("the address", () => {
  it("restores both sides, signals and offset", () => {
    const place = {
      a: { source: "yard loop", device: "1", begin: 1_760_000_000.5, end: 1_760_000_009.25 },
      b: { source: "2", device: "", last: 30 },
      signal: "norm(Acceleration) - 1 g",
      signalB: "IMU.acc",
      offset: -86_400.123456,
    };
    expect(readComparison(queryOf(comparisonHref(place)))).toEqual(place);
  });

  it("is one of the library's page with an A", () => {
    const route = { page: "recordings", device: undefined, place: undefined, more: undefined } as const;
    expect(isComparison({ ...route, query: "a=1&b=2" })).toBe(true);
    expect(isComparison({ ...route, query: "alpha=1" })).toBe(false);
    expect(isComparison({ ...route, query: "a=1", recording: "x" })).toBe(false);
  });

  it("reads what is mistyped as absent", () => {
    expect(readComparison("a=1&a0=x&al=-3&offset=")).toEqual({
      a: { source: "1", device: "" },
      signal: "",
      signalB: "",
    });
  });
});

describe("what a view gives", () => {
  const view = { device: "1", live: true, end: 1000, span: 60, timeBase: "device" } as const;

  it("is the window of a live device, while it follows and while it is paused", () => {
    const state = createViewState();
    state.view.value = view;
    expect(sideOf("1", "", state)).toEqual({ source: "1", device: "", last: 60 });
    state.view.value = { ...view, live: false };
    expect(sideOf("1", "", state)).toEqual({ source: "1", device: "", begin: 940, end: 1000 });
  });

  it("is the stretch between the cursors if both are set", () => {
    const state = createViewState();
    state.view.value = view;
    state.cursor.value = { kind: "pinned", time: 990 };
    state.measure.value = 980;
    expect(sideOf("yard", "1", state)).toEqual({ source: "yard", device: "1", begin: 980, end: 990 });
    state.measure.value = undefined;
    expect(sideOf("yard", "1", state)).toEqual({ source: "yard", device: "1" });
  });
});

describe("the other side", () => {
  const device = (id: string, product: string): DeviceInfo => ({ id, product, status: "live" }) as DeviceInfo;
  const recording = (id: string, product: string): RecordingInfo =>
    ({ id, deleted: null, recording: false, devices: [{ product }] }) as unknown as RecordingInfo;
  const a = { source: "1", device: "" };

  it("is a live device of the same product, then any, then a recording, then A itself", () => {
    const devices = [device("1", "MTi"), device("2", "IMX"), device("3", "MTi")];
    expect(likelyOther(a, "MTi", devices, []).source).toBe("3");
    expect(likelyOther(a, "MTi", devices.slice(0, 2), []).source).toBe("2");
    expect(likelyOther(a, "MTi", devices.slice(0, 1), [recording("x", "IMX"), recording("y", "MTi")]).source).toBe("y");
    expect(likelyOther(a, "MTi", devices.slice(0, 1), [])).toBe(a);
  });

  it("of a recording is not an unlike device", () => {
    const all = [recording("x", "MTi"), recording("y", "MTi")];
    expect(likelyOther({ source: "x", device: "" }, "MTi", [device("2", "IMX")], all).source).toBe("y");
  });
});

it("a live side ends now", () => {
  expect(requestedSide({ source: "1", device: "", last: 30 }, 1000)).toEqual({
    source: "1",
    device: "",
    t0: 970,
    t1: 1000,
  });
});
