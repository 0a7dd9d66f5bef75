import { beforeEach, describe, expect, it } from "vitest";
import { protocol } from "../testing/capabilities";
import type { Store } from "../data/store";
import { recently } from "./panel-context";
import { capabilities, countsLosses } from "../wire/capabilities";
import type { DeviceHealth, DeviceInfo, EventInfo } from "../wire/types";
import {
  healthFigures,
  isLeftOut,
  presumedWords,
  type Recent,
  recentOf,
  timeWords,
  totals,
  verdict,
} from "./health-text";

const health: DeviceHealth = {
  device: "1",
  time: 100,
  rate: 400,
  messages: [{ name: "MTData2", rate: 400, count: 4000 }],
  gaps: 3,
  lost: 90,
  numbered: 4000,
  rejects: 2,
  unclaimed: 17,
  bytes: 1e6,
  bytes_per_s: 31242,
  capacity: 92160,
  jitter_ms: 0.314,
  last_arrival: 99.99,
  drift_ppm: 12.42,
  drift_bound_ppm: null,
  time_presumes: "",
  uncertainty_ms: 0.2,
  rejects_by: {},
  verified: null,
  unverified: null,
  dropped: 0,
  behind: { link: 0, decoding: 0, reason: "" },
  jitter_cause: null,
};
const quiet = { gaps: 0, lost: 0, blind: 0, rejects: 0 };
const device = { id: "1", status: "live", message: "", hint: "" } as unknown as DeviceInfo;

describe("figuresOf", () => {
  it("has no colour without recent losses", () => {
    const figures = healthFigures(health, quiet, 0.004, 0);
    expect(
      Object.values(figures)
        .map((figure) => (typeof figure === "object" ? figure.tone : ""))
        .join(""),
    ).toBe("");
    expect(figures.shareText.value).toBe("33.9");
    // "Last minute" counts its own losses; those of the session are shown beside it.
    expect(figures.gaps).toEqual({ value: "0", unit: "smp", tone: "" });
    expect(figures.rejects).toEqual({ value: "0", unit: "frames", tone: "" });
    expect(totals(health)).toBe(
      "Since the session began: 3 gaps, 90 samples lost, 2 frames rejected, 17 bytes in no accepted message.",
    );
    expect(figures.drift.value).toBe("+12.4");
    expect(figures.age).toEqual({ value: "4", unit: "ms ago", tone: "" });
  });
  it("warns of losses within the minute, late samples and a full link", () => {
    const figures = healthFigures(
      { ...health, bytes_per_s: 90000 },
      { gaps: 1, lost: 72, blind: 0, rejects: 1 },
      2.5,
      10,
    );
    expect(figures.gaps).toEqual({ value: "1 · 72 smp", unit: "", tone: "warn" });
    expect(figures.rejects).toEqual({ value: "1", unit: "frame", tone: "warn" });
    expect(figures.age.tone).toBe("bad");
    expect(figures.shareText.tone).toBe("warn");
    expect(figures.dropped.tone).toBe("warn");
  });
  it("gives the duration of an outage without counted samples", () => {
    const gaps = (recent: Partial<Recent>): string => healthFigures(health, { ...quiet, ...recent }, 0, 0).gaps.value;
    expect(gaps({ gaps: 1, blind: 15.3 })).toBe("1 · 15 s");
    expect(gaps({ gaps: 3, lost: 72, blind: 15.3 })).toBe("3 · 72 smp + 15 s");
  });
  it("gives the uncertainty of device times, rounded up, and marks a large one, whatever its cause", () => {
    const bound = (ms: number | null) => healthFigures({ ...health, uncertainty_ms: ms }, quiet, 0, 0).uncertainty;
    expect(bound(0.36)).toEqual({ value: "± 0.4", unit: "ms", tone: "" });
    expect(bound(0.062).value).toBe("± 0.07");
    expect(bound(15.2)).toEqual({ value: "± 16", unit: "ms", tone: "warn" });
    expect(bound(0.4).value).toBe("± 0.4");
    expect(bound(null).value).toBe("—");
    expect(timeWords(health)).toBe("");
    const uneven = {
      ...health,
      jitter_cause: { kind: "bursts" as const, text: "It comes in bursts.", remedy: "Set the timer." },
    };
    expect(healthFigures(uneven, quiet, 0, 0).uncertainty.tone).toBe("");
    expect(timeWords(uneven)).toBe("It comes in bursts. Set the timer.");
  });
  it("says what an uncertainty presumes, or why it is unknown", () => {
    expect(presumedWords(health)).toBe("");
    const presumed = { ...health, drift_bound_ppm: 3.21, time_presumes: "if not all frames are delayed alike" };
    expect(presumedWords(presumed)).toBe("± of times holds if not all frames are delayed alike.");
    expect(healthFigures(presumed, quiet, 0, 0).drift.value).toBe("+12.4 ± 3.3");
    const wide = { ...presumed, drift_bound_ppm: 51.02 };
    expect(healthFigures(wide, quiet, 0, 0).drift.value).toBe("+12 ± 52"); // what fits in its column
    const full = { ...health, uncertainty_ms: null, time_presumes: "the line is full" };
    expect(presumedWords(full)).toBe("The uncertainty of times is unknown: the line is full.");
  });
  it("judges nothing while decoding is behind, and no loss before the first samples", () => {
    const behind = healthFigures({ ...health, behind: { link: 0, decoding: 12, reason: "" } }, quiet, 12, 0);
    const shown = ["samples", "gaps", "rejects", "age"] as const;
    expect(shown.map((key) => behind[key].value)).toEqual(["—", "—", "—", "—"]);
    expect(behind.age.tone).toBe("");
    expect(behind.bytes.value).not.toBe("—");
    const found = healthFigures(
      { ...health, behind: { link: 0, decoding: 12, reason: "" } },
      { gaps: 1, lost: 72, blind: 0, rejects: 1 },
      12,
      0,
    );
    expect([found.gaps.tone, found.rejects.value]).toEqual(["warn", "1"]);
    const first = healthFigures({ ...health, messages: [], bytes: 0 }, quiet, undefined, 0);
    expect([first.gaps.value, first.rejects.value]).toEqual(["—", "—"]);
  });
  it("calls a device late by its own usual step", () => {
    const tone = (old: number, step: number) => healthFigures(health, quiet, old, 0, true, true, step).age.tone;
    expect([tone(2.5, 0.01), tone(2.5, 2), tone(7, 2), tone(60, Infinity)]).toEqual(["bad", "", "bad", ""]);
  });
  it("shows nothing before the first report", () => {
    const figures = healthFigures(undefined, quiet, undefined, 0);
    expect(figures.samples.value).toBe("—");
    expect(figures.share).toBeUndefined();
    expect(figures.drift.value).toBe("—");
  });
});

describe("a device that is known by messages", () => {
  const link = (name: string, counts_messages: boolean) => ({
    name,
    title: "",
    examples: [],
    shareable: false,
    counts_messages,
  });
  const of = (link: string): DeviceInfo => ({ ...device, protocol: "messages", link });
  const clean = { ...health, gaps: 0, lost: 0, rejects: 0 };

  it("claims no loss only where its publishers number their messages", () => {
    capabilities.value = {
      protocols: [],
      exports: [],
      absent: [],
      links: [link("foxglove", false), link("ros2", true)],
    };
    expect(countsLosses(of("ros2"), [])).toBe(true);
    expect(verdict(of("ros2"), [], [], clean, 0)).toMatch(/^No loss/);
    expect(countsLosses(of("foxglove"), [])).toBe(false);
    expect(verdict(of("foxglove"), [], [], clean, 0)).toMatch(/cannot be counted/);
    expect(healthFigures(clean, quiet, 0, 0, true, false).gaps.value).toBe("—");
    capabilities.value = { protocols: [], exports: [], links: [], absent: [] };
  });
});

describe("recentOf", () => {
  const event = (time: number, kind: string, samples: number, data = {}): EventInfo =>
    ({ seq: 0, time, device: "1", kind, level: "error", text: "", t0: null, t1: null, samples, data }) as EventInfo;
  it("counts the last minute of one device, sums included", () => {
    const events = [
      event(10, "gap", 5),
      event(50, "gap", 7),
      event(60, "gap", 90, { gaps: 12 }),
      event(70, "reject", 3),
      event(75, "reply", 0),
    ];
    expect(recentOf(events, "1", 80)).toEqual({ gaps: 13, lost: 97, blind: 0, rejects: 3 });
    expect(recentOf(events, "2", 80)).toEqual(quiet);
  });
  it("counts the minute before the end of a file that has ended", () => {
    const events = [event(10, "gap", 5), event(50, "gap", 7)];
    const store = { events: { value: events }, edgeOf: () => 60, serverNow: () => 1000 } as unknown as Store;
    expect(recently({ store }, "1")).toMatchObject({ gaps: 2, lost: 12 });
  });
});

describe("verdict", () => {
  const gap = {
    seq: 1,
    time: 52333,
    device: "1",
    kind: "gap",
    level: "error",
    text: "72 samples lost (180 ms): on the device's side",
  };
  const events = [{ ...gap, t0: 52333, t1: 52333.18, samples: 72, data: {} } as EventInfo];
  const clean = { ...health, gaps: 0, lost: 0, rejects: 0 };
  const sent = (name: string, group = "") => [{ name, group }];
  const counting = sent("PacketCounter");
  const told = (change: Partial<DeviceHealth>, of: Partial<DeviceInfo> = {}, channels = counting): string =>
    verdict({ ...device, protocol: "xbus", ...of }, channels, [], { ...clean, ...change }, 0);

  beforeEach(() => {
    const protocols = [
      protocol({ name: "xbus", counts_losses: true, counter: "PacketCounter" }),
      protocol({ name: "isb" }),
    ];
    capabilities.value = { protocols, exports: [], links: [], absent: [] };
    return () => (capabilities.value = { protocols: [], exports: [], links: [], absent: [] });
  });

  it("names where samples were lost", () => {
    const gap = "Gap 14:32:13: 72 samples lost (180 ms): on the device's side.";
    expect(verdict(device, counting, events, health, 0)).toBe(gap);
    const here = "7 samples not sent to this browser because it did not take them in time.";
    expect(verdict(device, counting, events, health, 7)).toBe(`${here} ${gap}`);
    expect(told({ rejects: 2 })).toMatch(
      /^2 frames failed verification .* No sample is missing by the device's counter.$/,
    );
    expect(told({})).toBe("No loss since this session began.");
  });
  it("claims no loss only where that is known", () => {
    const rows: [string, string][] = [
      ["lost before the events in memory", told({ lost: 5, gaps: 1 })],
      ["Losses in that time are not known yet.", told({ behind: { link: 0, decoding: 12, reason: "" } })],
      ["No samples yet: nothing is known about loss.", told({ messages: [] })],
      ["No samples yet: nothing is known about loss.", told({ messages: [{ name: "a", rate: 0, count: 0 }] })],
      ["The device does not send PacketCounter: lost samples cannot be counted.", told({}, {}, sent("Acceleration"))],
      ["The samples have no numbers: lost ones cannot be counted.", told({}, {}, sent("GNGGA", "NMEA GNGGA"))],
      ["The samples have no numbers: lost ones cannot be counted.", told({}, { protocol: "isb" })],
      ["discarded. The samples have no numbers", told({ rejects: 1 }, { protocol: "isb" })],
    ];
    for (const [words, text] of rows) {
      expect(text.replace("lost since the session began, before", "lost before")).toContain(words);
      expect(text).not.toContain("No loss");
    }
  });
  it("does not report a recording as lossless if losses follow later", () => {
    const recorded = (later?: number) => verdict({ ...device, protocol: "xbus" }, counting, [], clean, 0, later);
    expect(recorded()).toContain("this session");
    expect(recorded(0)).toBe("No loss in this recording.");
    const begun = { ...clean, messages: [{ name: "a", rate: 100, count: 0 }] }; // with the playhead at its start
    expect(verdict({ ...device, protocol: "" }, [], [], begun, 0, 0)).toMatch(/^The samples have no numbers/);
    expect(recorded(165)).toBe("No loss up to here; 165 samples are missing later.");
  });
  it("reports the cause of a lost device first", () => {
    const lost = { ...device, status: "lost", message: "ttyUSB0 is gone.", hint: "Plug it in again." } as DeviceInfo;
    expect(verdict(lost, counting, events, health, 3)).toBe("ttyUSB0 is gone. Plug it in again.");
  });
});

it("a recording has no rows about the link and this browser now", () => {
  const device = { protocol: "xbus" };
  expect(["samples", "age", "shareText", "dropped"].filter((key) => isLeftOut(key as "age", device, true))).toEqual([
    "age",
    "shareText",
    "dropped",
  ]);
  expect(isLeftOut("age", device, false)).toBe(false);
});
