import { beforeEach, describe, expect, it, vi } from "vitest";
import type { SampleFrame } from "../wire/codec";
import type { ChannelInfo, ColumnInfo, DeviceInfo, EventInfo } from "../wire/types";
import { channelInfo, columnInfo, eventInfo } from "../testing/fixtures";
import { sampleFrame } from "../testing/samples";
import { liveSource } from "../measure/sample-access";
import { isShared } from "../signals/names";
import { Store } from "./store";

const column = (name: string, axis: ColumnInfo["axis"] = "", unit = ""): ColumnInfo => columnInfo({ name, axis, unit });
const info = (id: number, name: string, kind: ChannelInfo["kind"], columns: ColumnInfo[]): ChannelInfo =>
  channelInfo({ id, name, kind, frame: "ENU from body", columns });
const acceleration = info(1, "Acceleration", "vector", [column("x", "x"), column("y", "y"), column("z", "z")]);
const quaternion = info(
  2,
  "Quaternion",
  "quaternion",
  ["q0", "q1", "q2", "q3"].map((name) => column(name)),
);
const HALF = Math.SQRT1_2;

function frame(
  channel: number,
  sequence: number,
  n: number,
  values: readonly number[],
  more: Partial<SampleFrame> = {},
): SampleFrame {
  const times = Array.from({ length: n }, (_, k) => 1000 + (sequence + k) * 0.01);
  const columns = values.map((v) => new Float32Array(n).fill(v));
  return sampleFrame(times, columns, { channel, sequence, ...more });
}
const send = (store: Store, ...frames: SampleFrame[]): void => store.receive({ kind: "frames", frames, received: NaN });
const event = (seq: number, more: Partial<EventInfo> = {}): EventInfo => eventInfo({ seq, ...more });

let store: Store;
beforeEach(() => {
  store = new Store();
  store.receive({ kind: "subscribed", fresh: true });
  store.receive({ kind: "text", text: { op: "channels", channels: [acceleration, quaternion] } });
});

describe("derived quantities", () => {
  it("are computed with the samples: norm and Euler angles", () => {
    send(store, frame(1, 0, 3, [2, 3, 6]), frame(2, 0, 3, [HALF, 0, 0, HALF]));
    const vector = store.channel("1", "Acceleration")!;
    expect(vector.info.columns.map(({ name }) => name)).toEqual(["x", "y", "z", "norm"]);
    expect(vector.ring.value(3, 2)).toBe(7);
    const euler = store.channel("1", "EulerAngles")!;
    expect(euler.info).toMatchObject({ id: -3, kind: "euler", unit: "°", frame: "ENU from body" });
    expect([euler.ring.length, euler.ring.value(0, 0), euler.ring.value(1, 0)]).toEqual([3, 0, -0]);
    expect(euler.ring.value(2, 2)).toBeCloseTo(90, 4);
    expect(euler.ring.time(1)).toBe(vector.ring.time(1));
  });

  it("are replaced by the device's own Euler angles", () => {
    const own = info(
      9,
      "EulerAngles",
      "euler",
      ["roll", "pitch", "yaw"].map((name) => column(name)),
    );
    store.receive({ kind: "text", text: { op: "channels", channels: [own] } });
    expect(
      store.channels.value.filter(({ info: { name } }) => name === "EulerAngles").map(({ info: { id } }) => id),
    ).toEqual([9]);
  });
});

it("keeps the newest channel of a name", () => {
  store.receive({ kind: "text", text: { op: "channels", channels: [{ ...acceleration, id: 5 }] } });
  expect(store.channels.value.map(({ info: { id } }) => id).sort()).toEqual([-3, 2, 5]);
  send(store, frame(1, 0, 3, [1, 1, 1])); // a late sample of the old one
  expect(store.channel("1", "Acceleration")!.ring.length).toBe(0);
});

it("asks the server for a quantity that came in two messages by its message", () => {
  expect(liveSource(store, "1").prefix(acceleration)).toBe("");
  const other = { ...acceleration, id: 5, message: "Imu3Acc" };
  store.receive({ kind: "text", text: { op: "channels", channels: [other] } });
  expect(liveSource(store, "1").prefix(other)).toBe("Imu3Acc/");
  expect(isShared(acceleration, [acceleration, other])).toBe(true);
  expect(isShared(acceleration, [acceleration, { ...acceleration, id: 6 }])).toBe(false);
});

describe("a connection that was lost", () => {
  const missed = [
    frame(1, 30, 10, [0, 0, 3], { history: true }),
    frame(1, 20, 10, [0, 0, 2], { history: true }),
    frame(1, 5, 15, [0, 0, 1], { history: true }),
  ];

  it("receives only the missed samples, in order and once", () => {
    send(store, frame(1, 0, 20, [0, 0, 1]));
    store.receive({ kind: "subscribed", fresh: false });
    send(store, frame(1, 40, 5, [0, 0, 4]), ...missed, frame(1, 45, 5, [0, 0, 4]));
    expect(store.channel("1", "Acceleration")!.ring.length).toBe(20);
    store.receive({ kind: "text", text: { op: "history_end" } });
    const { ring } = store.channel("1", "Acceleration")!;
    expect(Array.from({ length: ring.length }, (_, i) => ring.value(2, i))).toEqual(
      [1, 2, 3, 4].flatMap((v) => Array<number>(v === 1 ? 20 : 10).fill(v)),
    );
    expect(ring.breaks).toEqual([]);
  });

  it("is not waited for without a limit", () => {
    vi.useFakeTimers();
    send(store, frame(1, 0, 20, [0, 0, 1]));
    store.receive({ kind: "subscribed", fresh: false });
    send(store, frame(1, 40, 5, [0, 0, 4]));
    vi.advanceTimersByTime(3100);
    vi.useRealTimers();
    const { ring } = store.channel("1", "Acceleration")!;
    expect(ring.length).toBe(25);
    expect(ring.breaks.map((row) => row - ring.first)).toEqual([20]);
  });
});

describe("a server that was restarted", () => {
  const device = (id: string, more: Partial<DeviceInfo> = {}) =>
    ({
      id,
      name: "MTi",
      source: "/dev/ttyUSB0",
      protocol: "xbus",
      serial_number: "7",
      parent: "",
      status: "live",
      ...more,
    }) as DeviceInfo;
  const devices = (...list: readonly DeviceInfo[]): void =>
    store.receive({ kind: "text", text: { op: "devices", devices: list } });
  const channels = (...list: readonly ChannelInfo[]): void =>
    store.receive({ kind: "text", text: { op: "channels", channels: list } });
  /** Another run, a second later, that has sent 10 samples already and continues. */
  const later = (sequence: number, n: number, value: number, history = false) => {
    const made = frame(5, sequence, n, [0, 0, value], { history });
    return { ...made, arrival: made.arrival.map((t) => t + 1.2), time: made.time.map((t) => t + 1.2) };
  };
  const restart = (now: DeviceInfo): void => {
    store.receive({ kind: "subscribed", fresh: true });
    devices({ ...now, serial_number: "" }); // not known yet
    channels({ ...acceleration, id: 5, device: now.id });
    send(store, later(10, 2, 3), later(5, 5, 2, true), later(0, 5, 2, true));
    store.receive({ kind: "text", text: { op: "history_end" } });
    devices(now);
    send(store, later(12, 2, 4));
  };
  beforeEach(() => {
    devices(device("1"));
    store.receive({
      kind: "text",
      text: { op: "events", events: [event(3), event(4, { kind: "gap", t0: 1000.02, t1: 1000.05, samples: 2 })] },
    });
    send(store, frame(1, 0, 20, [0, 0, 1]), frame(2, 0, 20, [HALF, 0, 0, HALF]));
  });
  const z = (id: string): readonly number[] => {
    const { ring } = store.channel(id, "Acceleration")!;
    return Array.from({ length: ring.length }, (_, i) => ring.value(2, i));
  };

  it("keeps earlier data on the page, with a gap in between", () => {
    restart(device("2")); // with another id
    expect(z("2")).toEqual([...Array<number>(20).fill(1), ...Array<number>(10).fill(2), 3, 3, 4, 4]);
    const { ring } = store.channel("2", "Acceleration")!;
    expect(ring.breaks.map((row) => row - ring.first)).toEqual([20]);
    const losses = store.losses("2");
    expect(losses.map(({ by, samples }) => [by, samples])).toEqual([
      ["device", 2],
      ["server", 0],
    ]);
    expect([losses[1]!.t0, losses[1]!.t1]).toEqual([frame(1, 19, 1, [0]).arrival[0], later(0, 1, 0).arrival[0]]);
    store.receive({ kind: "text", text: { op: "events", events: [event(0, { device: "2", text: "new" })] } });
    expect(store.events.value.map(({ seq, device: id }) => [seq, id])).toEqual([
      [-2, "2"],
      [-1, "2"],
      [0, "2"],
    ]);
  });

  it("keeps derived quantities and the chosen frame", () => {
    store.showIn("NED");
    const before = store.channel("1", "EulerAngles")!.ring.value(2, 0);
    store.receive({ kind: "subscribed", fresh: true });
    devices(device("1"));
    channels({ ...quaternion, id: 1 });
    const euler = store.channel("1", "EulerAngles")!;
    expect(euler.info.frame).toBe("NED from body");
    expect([euler.ring.length, euler.ring.value(2, 0)]).toEqual([20, expect.closeTo(before, 4)]);
  });

  it("shows no data of another device at the same port", () => {
    restart(device("1", { serial_number: "8" }));
    expect(z("1")).toEqual([4, 4]);
    expect(store.losses("1")).toEqual([]);
    expect(store.events.value).toEqual([]);
  });

  it("restarts if the clock of the host was set back", () => {
    store.receive({ kind: "subscribed", fresh: true });
    devices(device("1"));
    channels({ ...acceleration, id: 5 });
    store.receive({ kind: "text", text: { op: "history_end" } });
    const early = frame(5, 0, 3, [0, 0, 9]);
    send(store, { ...early, arrival: early.arrival.map((t) => t - 60), time: early.time.map((t) => t - 60) });
    expect(z("1")).toEqual([9, 9, 9]);
  });
});

describe("missing samples", () => {
  it("are reported by gap events, once, also if these are sent again", () => {
    const gap = event(4, { kind: "gap", t0: 1001, t1: 1001.18, samples: 72 });
    store.receive({ kind: "text", text: { op: "events", events: [event(3), gap] } });
    store.receive({ kind: "text", text: { op: "events", events: [event(3), gap, event(5)] } });
    expect(store.events.value.map(({ seq }) => seq)).toEqual([3, 4, 5]);
    expect(store.losses("1")).toMatchObject([{ t0: 1001, t1: 1001.18, samples: 72, by: "device" }]);
  });

  it("include drops for this browser, once for all channels of a moment", () => {
    send(store, frame(1, 0, 20, [0, 0, 1]), frame(2, 0, 20, [1, 0, 0, 0]));
    send(store, frame(1, 50, 5, [0, 0, 1], { dropped: 30 }), frame(2, 50, 5, [1, 0, 0, 0], { dropped: 30 }));
    expect(store.dropped()).toBe(60);
    expect(store.losses("1")).toMatchObject([{ samples: 30, by: "browser" }]);
    expect(store.channel("1", "Acceleration")!.ring.breaks.length).toBe(1);
  });
});

it("break the lines of that device alone at a clock restart, in all its channels", () => {
  send(store, frame(1, 0, 20, [0, 0, 1]));
  const step = event(4, { kind: "clock", time: 1000.1 });
  store.receive({
    kind: "text",
    text: { op: "events", events: [step, event(5, { kind: "clock", time: 1000.05, device: "2" })] },
  });
  store.receive({
    kind: "text",
    text: { op: "channels", channels: [{ ...acceleration, id: 7, name: "FreeAcceleration" }] },
  });
  send(store, frame(7, 0, 20, [0, 0, 1]), frame(2, 0, 20, [1, 0, 0, 0]));
  for (const name of ["Acceleration", "FreeAcceleration", "Quaternion", "EulerAngles"]) {
    const { ring } = store.channel("1", name)!;
    expect(ring.breaks.map((row) => ring.time(row - ring.first))).toEqual([1000.1]);
  }
});

describe("verified and unverified quantities", () => {
  it("are in this order if a quantity arrived both ways, and the horizon uses the verified one", () => {
    const old = {
      ...info(
        7,
        "Quaternion?",
        "quaternion",
        ["q0", "q1", "q2", "q3"].map((name) => column(name)),
      ),
      device: "9",
      verified: false,
    };
    const pressure = { ...info(8, "Pressure?", "scalar", [column("value")]), device: "9", verified: false };
    store.receive({ kind: "text", text: { op: "channels", channels: [old, pressure] } });
    const names = (): readonly string[] =>
      store.channels.value.filter((one) => one.info.device === "9").map((one) => one.info.name);
    const euler = (): boolean | undefined => store.channel("9", "EulerAngles")?.info.verified;
    expect(names()).toEqual(["Quaternion?", "Pressure?", "EulerAngles"]);
    expect(euler()).toBe(false);
    store.receive({
      kind: "text",
      text: { op: "channels", channels: [{ ...old, id: 9, name: "Quaternion", verified: true }] },
    });
    expect(names()).toEqual(["Pressure?", "Quaternion", "EulerAngles", "Quaternion?"]);
    expect(euler()).toBe(true);
  });
});

describe("the chosen frame", () => {
  const felt = {
    ...info(4, "RateOfTurn", "vector", [column("x", "x", "°/s"), column("y", "y", "°/s"), column("z", "z", "°/s")]),
    frame: "",
  };
  const row = (name: string): number[] => {
    const { ring } = store.channel("1", name)!;
    return ring.columns.map((_, c) => Number(ring.value(c, ring.length - 1).toFixed(4)));
  };

  it("applies to stored and new samples, attitude, body and world", () => {
    store.receive({ kind: "text", text: { op: "channels", channels: [felt] } });
    send(store, frame(4, 0, 2, [1, 2, 3]), frame(2, 0, 2, [1, 0, 0, 0]));
    expect(store.nativeFrame("1")).toBe("ENU");
    store.showIn("NED");
    expect(row("RateOfTurn")).toEqual([1, -2, -3, 3.7417]);
    expect(row("EulerAngles").map(Math.abs)).toEqual([0, 0, 90]); // level, east, without a roll of 180°
    send(store, frame(4, 2, 2, [4, 5, 6]), frame(2, 2, 2, [HALF, 0, 0, HALF]));
    expect(row("RateOfTurn").slice(0, 3)).toEqual([4, -5, -6]);
    expect(row("EulerAngles").map((v) => Math.abs(v) < 0.001)).toEqual([true, true, true]); // north
    expect(store.channel("1", "RateOfTurn")!.info.frame).toBe("FRD");
    expect(store.channel("1", "EulerAngles")!.info.frame).toBe("NED from body");
    store.showIn(undefined);
    expect(row("RateOfTurn").slice(0, 3)).toEqual([4, 5, 6]);
    expect(row("EulerAngles")[2]).toBeCloseTo(90, 3);
    expect(store.channel("1", "RateOfTurn")!.info.frame).toBe("");
  });

  it("applies to later channels too", () => {
    store.showIn("NED");
    store.receive({ kind: "text", text: { op: "channels", channels: [felt] } });
    send(store, frame(4, 0, 2, [1, 2, 3]));
    expect(row("RateOfTurn").slice(0, 3)).toEqual([1, -2, -3]);
  });
});

it("breaks the lines of a channel over losses reported before it", () => {
  store.receive({
    kind: "text",
    text: { op: "events", events: [event(1, { kind: "gap", t0: 1000.095, t1: 1000.115, samples: 1 })] },
  });
  const late = info(7, "MagneticField", "vector", [column("x", "x"), column("y", "y"), column("z", "z")]);
  store.receive({ kind: "text", text: { op: "channels", channels: [late] } });
  const at = Float64Array.from(
    [...Array(21).keys()].filter((k) => k !== 10),
    (k) => 1000 + k * 0.01,
  );
  send(store, { ...frame(7, 0, 20, [1, 2, 3]), arrival: at, time: at });
  const { ring } = store.channel("1", "MagneticField")!;
  expect(ring.breaks.map((row) => row - ring.first)).toEqual([10]);
});
