import { describe, expect, it } from "vitest";
import { Ring } from "../data/ring-buffer";
import type { Channel } from "../data/channels";
import { channelInfo, columnInfo } from "../testing/fixtures";
import type { ChannelInfo, ColumnInfo } from "../wire/types";
import { duration, tickLabel, timeGrid, timeStep } from "./axis";
import { PixelColumns } from "./pixel-columns";
import { labelWords } from "../ui/format/labels";
import { docOf } from "./lane-names";
import { inPlace, lanesOf, runsOf, bitStateWords } from "./status-lanes";
import { stripLength } from "./history-strip";
import { niceStep, Scale, ticks } from "../charts/scale";
import { usualPlots } from "../signals/plot-selection";
import { CHANNELS, frameOf, STATUS_BITS } from "../testing/synthetic";
import { timeAt, timeWindow, xOf, type TimeWindow } from "./time-window";

const windowOf = (end: number, span: number, width = 200): TimeWindow =>
  timeWindow({ device: "1", live: false, end, span, timeBase: "device" }, end, 100, width, 1);

function ringOf(info: ChannelInfo): Ring {
  return new Ring(info.columns.map(({ dtype, period, bits }) => ({ dtype, period, status: bits.length > 0 })));
}

describe("the window", () => {
  it("moves in whole pixels, so that each pixel keeps its samples", () => {
    for (const end of [1000.001, 1000.05, 1000.0999]) expect(windowOf(end, 20).g1).toBe(10_001);
    expect(windowOf(1000.2001, 20).g1).toBe(10_003);
  });

  it("maps time to position and back", () => {
    const w = windowOf(1000, 20);
    expect(xOf(w, w.t0)).toBe(100);
    expect(xOf(w, w.t1)).toBe(300);
    expect(timeAt(w, xOf(w, 993.25))).toBeCloseTo(993.25, 9);
  });
});

describe("columns of pixels", () => {
  /** Result of a slow pass over every sample. */
  function oracle(ring: Ring, g: number, dt: number): [number, number] {
    let [lo, hi] = [Infinity, -Infinity];
    for (let i = 0; i < ring.length; i++) {
      if (ring.time(i) < g * dt || ring.time(i) >= (g + 1) * dt) continue;
      [lo, hi] = [Math.min(lo, ring.value(0, i)), Math.max(hi, ring.value(0, i))];
    }
    return [lo, hi];
  }

  it("agree with all samples while samples arrive and the window moves, zooms and jumps", () => {
    const info = CHANNELS[0]!;
    const ring = ringOf(info);
    const columns = new PixelColumns(ring, [0]);
    let sent = 0;
    let state = 5;
    const random = (): number => (state = (Math.imul(state, 1_664_525) + 1_013_904_223) >>> 0) / 2 ** 32;
    let span = 5;
    for (let step = 0; step < 60; step++) {
      const n = 1 + Math.floor(random() * 40);
      ring.take(
        frameOf(
          info,
          sent,
          Float64Array.from({ length: n }, (_, k) => 1000 + (sent + k) * 0.01),
          false,
        ),
      );
      sent += n;
      if (random() < 0.15) span = 1 + random() * 8;
      const end = ring.time(ring.length - 1) + random() * 0.3 - (random() < 0.2 ? 3 : 0);
      const w = windowOf(end, span, 120);
      columns.prepare(w.g0, w.g1, w.dt, "device");
      for (let g = w.g0; g < w.g1; g++) {
        expect([columns.lo[0]![g & columns.mask], columns.hi[0]![g & columns.mask]]).toEqual(oracle(ring, g, w.dt));
      }
    }
  });
});

describe("the y scale", () => {
  it("widens at once and narrows only after five seconds of spare room", () => {
    const scale = new Scale(0.01);
    scale.update(-1, 1, 0, false);
    scale.update(-10, 1, 100, false);
    expect(scale.lo).toBeLessThanOrEqual(-10);
    const { lo, hi } = scale;
    for (let now = 200; now < 5100; now += 100) scale.update(-1, 1, now, false);
    expect([scale.lo, scale.hi]).toEqual([lo, hi]);
    scale.update(-1, 1, 5300, false);
    expect(scale.lo).toBeGreaterThan(-3);
  });

  it("keeps its wide span when the room was needed in between", () => {
    const scale = new Scale(0.01);
    scale.update(-10, 10, 0, false);
    const { lo } = scale;
    scale.update(-1, 1, 3000, false);
    scale.update(-10, 10, 4000, false);
    scale.update(-1, 1, 7000, false);
    expect(scale.lo).toBe(lo);
  });

  it("shows the full range of an angle", () => {
    const scale = new Scale(0.2, 360);
    scale.update(-179, 178, 0, true);
    expect([scale.lo, scale.hi]).toEqual([-190, 190]);
    expect(
      ticks(-190, 190, 80, true)
        .map(({ value }) => value)
        .sort((a, b) => a - b),
    ).toEqual([-180, -90, 0, 90, 180]);
  });

  it("has room around a constant, and ignores missing values", () => {
    const scale = new Scale(0.1);
    scale.update(Infinity, -Infinity, 0, false);
    scale.update(5, 5, 0, false);
    expect(scale.lo).toBeLessThan(5);
    expect(scale.hi).toBeGreaterThan(5);
  });

  it("puts ticks at round numbers, including zero", () => {
    expect([0.9, 1.1, 3, 7].map((least) => niceStep(least))).toEqual([1, 2, 5, 10]);
    expect(ticks(-6, 19, 100)[0]!.value).toBe(0);
    expect(ticks(-0.02, 0.02, 60).every(({ decimals }) => decimals === 2)).toBe(true);
  });
});

describe("the time axis", () => {
  it("has the steps of a clock", () => {
    expect(timeStep(20, 700)).toBe(2);
    expect(timeStep(3600, 700)).toBe(600);
    expect(timeStep(0.02, 700)).toBe(0.005);
    expect(timeGrid(windowOf(1000, 20, 700)).slice(0, 3)).toEqual([980, 982, 984]);
  });

  it("names the day at midnight, and milliseconds when they matter", () => {
    expect(tickLabel(1_795_219_200, 3600)).toBe("21 Nov");
    expect(tickLabel(1_795_225_931.125, 0.005)).toBe("01:52:11.125");
    expect([1.1141, 0.18, -0.0125, 75].map(duration)).toEqual(["1.114 s", "180.0 ms", "−12.50 ms", "1 min 15.0 s"]);
  });

  it("shows memory in common lengths", () => {
    expect(stripLength(625, 20)).toBe(600); // of ten minutes in memory the strip begins at −10 min, not at −20
    expect([stripLength(5, 20), stripLength(66, 20), stripLength(100, 600), stripLength(1e6, 1)]).toEqual([
      60, 120, 600, 1e6,
    ]);
  });
});

describe("chosen plots", () => {
  const channel = (
    name: string,
    kind: ChannelInfo["kind"],
    names: readonly (readonly [string, string])[],
    unit = "",
  ): Channel => {
    const columns = names.map(([column, axis]) => columnInfo({ name: column, unit, axis: axis as ColumnInfo["axis"] }));
    const info = channelInfo({ message: "", name, kind, unit, columns });
    return { info, ring: ringOf(info) };
  };
  const xyz = [
    ["x", "x"],
    ["y", "y"],
    ["z", "z"],
  ] as const;
  const angles = [
    ["roll", "x"],
    ["pitch", "y"],
    ["yaw", "z"],
  ] as const;
  const titles = (channels: readonly Channel[], primary: boolean): string[] =>
    usualPlots(channels)
      .filter((plot) => plot.primary === primary)
      .map(({ title }) => title);

  it("are in the design's order, one of each family", () => {
    const sent = [
      channel("EulerAngles", "euler", angles, "°"),
      channel("MagneticField", "vector", xyz, "a.u."),
      channel("RateOfTurn", "vector", xyz, "°/s"),
      channel("FreeAcceleration", "vector", xyz, "m/s²"),
      channel("Acceleration", "vector", xyz, "m/s²"),
      channel("PacketCounter", "counter", [["value", ""]]),
      channel("Temperature", "scalar", [["value", ""]], "°C"),
    ];
    expect(titles(sent, true)).toEqual(["Acceleration", "RateOfTurn", "MagneticField", "Roll, pitch", "Yaw"]);
    expect(titles(sent, false)).toEqual(["FreeAcceleration", "Temperature"]);
  });

  it("are those that the protocol chooses, in its order", () => {
    const sent = [
      channel("Acceleration", "vector", xyz, "m/s²"),
      channel("EulerAngles", "euler", angles, "°"),
      channel("Temperature", "scalar", [["value", ""]], "°C"),
    ];
    const of = (chosen: readonly string[]) =>
      usualPlots(sent, chosen)
        .filter(({ primary }) => primary)
        .map(({ title }) => title);
    expect(of(["Temperature", "EulerAngles", "Nothing"])).toEqual(["Temperature", "Roll, pitch", "Yaw"]);
    expect(of(["Nothing"])).toEqual(["Acceleration", "Roll, pitch", "Yaw"]);
  });

  it("are the first few quantities if none of the five is sent", () => {
    expect(
      titles(
        [
          channel("Temperature", "scalar", [["value", ""]], "°C"),
          channel("BaroPressure", "scalar", [["value", ""]], "Pa"),
        ],
        true,
      ),
    ).toEqual(["Temperature", "BaroPressure"]);
  });

  it("keep unnamed elements together, with the name of their field", () => {
    const numbered = (n: number): Channel =>
      channel(
        "Wheels",
        "vector",
        Array.from({ length: n }, (_, k) => [String(k), ""] as const),
        "m/s",
      );
    expect(titles([numbered(2)], true)).toEqual(["Wheels"]);
    expect(titles([numbered(5)], true)).toEqual(["Wheels 0, 1, 2", "Wheels 3, 4"]);
  });

  it("do not put latitude and longitude on one scale", () => {
    const plots = usualPlots([
      channel(
        "LatLon",
        "vector",
        [
          ["latitude", ""],
          ["longitude", ""],
        ],
        "°",
      ),
    ]);
    expect(plots.map(({ series }) => series.length)).toEqual([1, 1]);
  });
});

describe("lanes", () => {
  const info = CHANNELS.find(({ kind }) => kind === "status")!;
  const filled = (rows: readonly number[]): Channel => {
    const ring = ringOf(info);
    const times = Float64Array.from(rows, (_, k) => 1000 + k * 0.01);
    ring.take({ ...frameOf(info, 0, times, false), columns: [Uint32Array.from(rows)] });
    return { info, ring };
  };

  it("exist for flags that were set, enumerations, and flags whose clearing matters", () => {
    const names = (rows: number[]): string[] => lanesOf([filled(rows)]).map(({ name }) => name);
    expect(names([2, 2])).toEqual(["Filter valid", "RTK status", "No rotation update"]);
    expect(names([2, 2 | (1 << 10)])).toEqual(["Filter valid", "Clip acc Z", "RTK status", "No rotation update"]);
  });

  it("do not exist for features that a product lacks", () => {
    const names = (absent: readonly string[]): string[] => lanesOf([filled([0, 0])], absent).map(({ name }) => name);
    expect(names([])).toContain("Filter valid");
    expect(names(["FilterValid"])).not.toContain("Filter valid");
  });

  it("keep a flag of one sample at any zoom, and draw nothing after the newest sample", () => {
    const rows = Array.from({ length: 4000 }, (_, k) => 2 | (k === 1234 ? 1 << 10 : 0));
    const { ring } = filled(rows);
    const columns = new PixelColumns(ring, [0]);
    const w = windowOf(1050, 50, 100);
    columns.prepare(w.g0, w.g1, w.dt, "device");
    const clip = STATUS_BITS.find(({ name }) => name === "ClipAccZ")!;
    const set = runsOf(columns, 0, clip, w).filter(({ state }) => state === 1);
    expect(set).toHaveLength(1);
    expect(set[0]!.to - set[0]!.from).toBe(1);
    const last = runsOf(columns, 0, STATUS_BITS[0]!, w).at(-1)!;
    expect(last.to * w.dt).toBeCloseTo(1040, 0);
  });

  it("explain a value", () => {
    const rtk = STATUS_BITS.find(({ name }) => name === "RtkStatus")!;
    expect([0, 1, 3, -2].map((state) => bitStateWords(rtk, state))).toEqual(["no RTK", "floating", "3", "changing"]);
    expect(["ClipAccX", "FilterValid", "SyncIn Marker", "rtk_status", "GNSSFix"].map(labelWords)).toEqual([
      "Clip acc X",
      "Filter valid",
      "SyncIn Marker",
      "RTK status",
      "GNSS fix",
    ]);
  });
});

it("a cleared flag is not explained as set", () => {
  const bits = { ...STATUS_BITS[0]!, width: 1, doc: "At least one sensor is out of range." };
  expect(docOf({ bits }, "not set")).toBe("When set: at least one sensor is out of range.");
  expect(docOf({ bits }, "set")).toBe(bits.doc);
});

it("a newly set flag gets a lane below the others and moves none", () => {
  const info = CHANNELS.find(({ kind }) => kind === "status")!;
  const lanesAt = (word: number) => {
    const ring = ringOf(info);
    const frame = frameOf(info, 0, Float64Array.from([1, 2]), false);
    ring.take({ ...frame, columns: frame.columns.map(() => Uint32Array.from([2, word])) });
    const channels = [{ info, ring }];
    return { channels, lanes: lanesOf(channels) };
  };
  const [calm, clipped] = [lanesAt(2), lanesAt(2 | (1 << 10))];
  expect(clipped.lanes.length).toBe(calm.lanes.length + 1);
  const next = inPlace(calm.lanes, clipped.lanes);
  expect(next.slice(0, calm.lanes.length).map(({ name }) => name)).toEqual(calm.lanes.map(({ name }) => name));
});
