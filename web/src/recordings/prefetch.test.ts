import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { channelInfo, columnInfo } from "../testing/fixtures";
import { Prefetch } from "./prefetch";
import type { RecordingInfo } from "../wire/recording-types";

const info = (part: Partial<RecordingInfo> = {}): RecordingInfo =>
  ({
    id: "yard",
    title: "Yard",
    started: 1000,
    opened: true,
    recording: false,
    deleted: null,
    devices: [],
    ...part,
  }) as RecordingInfo;

const columns = [columnInfo({ name: "x", axis: "x" })];
const channel = channelInfo({ name: "Acceleration", kind: "vector", unit: "m/s²", columns });
const detail = {
  info: info(),
  t0: 1000,
  t1: 1060,
  devices: [{ id: "1", name: "one" }],
  channels: [channel],
  events: [],
  markers: [],
  snapshots: {},
  longest_s: { "1": 0.01 },
  progress: 1,
  begins: {},
};

describe("a recording that is about to be opened", () => {
  const asked: string[] = [];
  let prefetch = new Prefetch();
  beforeEach(() => {
    vi.useFakeTimers();
    prefetch = new Prefetch();
    asked.length = 0;
    vi.stubGlobal("fetch", (path: string) => {
      asked.push(path);
      const body = path.includes("/window") ? new ArrayBuffer(0) : JSON.stringify(detail);
      return Promise.resolve(
        new Response(body, { status: 200, headers: { "content-type": "application/json", "x-exact": "1" } }),
      );
    });
  });
  afterEach(async () => {
    (await prefetch.take("nobody", undefined)).screen?.dispose(); // dispose of a prepared one
  });
  const settled = () => vi.advanceTimersByTimeAsync(100);

  it("is prefetched, with its window, when the pointer rests on it", async () => {
    const known = info();
    prefetch.prepare(known, new Set());
    await settled();
    expect(asked.length).toBe(2);
    expect(asked[1]).toMatch(/window.*t0=1000&t1=1060/);
    const { outcome, screen } = await prefetch.take("yard", known);
    expect(outcome.ok).toBe(true);
    expect(screen?.held?.exact).toBe(true);
    expect(asked.length).toBe(2);
  });

  it("is not prefetched if the pointer only passes, or before it was first opened", async () => {
    prefetch.prepare(info(), new Set());
    prefetch.pass();
    prefetch.prepare(info({ opened: false }), new Set(), true);
    prefetch.prepare(info({ recording: true }), new Set(), true);
    await settled();
    expect(asked).toEqual([]);
  });

  it("is requested again if the library has changed it", async () => {
    prefetch.prepare(info(), new Set(), true);
    await settled();
    const { screen } = await prefetch.take("yard", info({ title: "Another" }));
    expect(asked.filter((path) => !path.includes("/window")).length).toBe(2);
    expect(screen?.held).toBeUndefined(); // a link may request another window
  });
});
