import { beforeEach, expect, it, vi } from "vitest";
import { createViewState } from "../data/view-state";
import { channelInfo, columnInfo } from "../testing/fixtures";
import { ReplayController } from "./replay-controller";
import type { RecordingDetail } from "../wire/recording-types";

const detail = (id: string, t0: number): RecordingDetail =>
  ({
    info: { id, title: id, started: t0 },
    t0,
    t1: t0 + 60,
    devices: [{ id: "1", name: "one" }],
    channels: [],
    events: [],
    markers: [],
    snapshots: {},
    longest_s: {},
    progress: 1,
    begins: {},
  }) as unknown as RecordingDetail;
const NOWHERE = { hide: [], show: [], panels: [] };

beforeEach(() => {
  vi.stubGlobal("fetch", () => Promise.resolve(new Response(new ArrayBuffer(0), { headers: { "x-exact": "1" } })));
});
it("opens at the first sample of its device, not before it, where every value is missing", () => {
  const later = { ...detail("late", 1000), begins: { "1": 1001.4 } };
  const opened = new ReplayController(later, NOWHERE, createViewState());
  expect([opened.head, opened.viewState.view.value.end]).toEqual([1001.4, 1060]);
  opened.go({ ...NOWHERE, cursor: 1000.5 }); // a link says where
  expect(opened.head).toBe(1000.5);
  opened.dispose();
});

it("two recordings side by side are read, played and shown independently of each other and of Live", () => {
  const live = createViewState();
  live.actions.pin(7);
  const left = new ReplayController(detail("left", 1000), NOWHERE, createViewState(live));
  const right = new ReplayController(detail("right", 5000), NOWHERE, createViewState(live));
  left.seek(1030);
  left.viewState.actions.select(1020, 1040);
  left.viewState.hiddenSeries.value = new Set(["Acceleration.x"]);
  right.toggle();
  for (let ms = 0; ms <= 1000; ms += 100) for (const one of [left, right]) one.tick(ms);
  expect(left.head).toBe(1030);
  expect(right.head).toBeCloseTo(5001, 3);
  expect(left.viewState.cursor.value).toEqual({ kind: "pinned", time: 1030 });
  expect(left.place()).toMatchObject({ t0: 1020, t1: 1040, cursor: 1030, hide: ["Acceleration.x"] });
  expect(right.place()).toMatchObject({ t0: 5000, t1: 5060, hide: [] });
  left.dispose();
  expect(right.viewState.view.value).toMatchObject({ end: 5060, span: 60 });
  right.dispose();
  expect(live.view.value).toMatchObject({ device: undefined, live: true, span: 20 });
  expect(live.actions.cursorTime()).toBe(7);
});

it("a server that was away while samples around the cursor were read is no problem once they are there", async () => {
  let isAway = true;
  vi.stubGlobal("fetch", (path: string) =>
    isAway && path.includes("width=8000") // those around the cursor
      ? Promise.reject(new TypeError())
      : Promise.resolve(new Response(new ArrayBuffer(0), { headers: { "x-exact": "1" } })),
  );
  const now = vi.spyOn(performance, "now").mockReturnValue(0);
  const channels = [channelInfo({ name: "Temperature", columns: [columnInfo()] })];
  const replay = new ReplayController({ ...detail("far", 1000), channels }, NOWHERE, createViewState());
  const settle = async (ms: number): Promise<void> => {
    now.mockReturnValue(ms);
    for (const _ of [1, 2, 3]) {
      await new Promise((resolve) => setTimeout(resolve));
      replay.tick(ms);
    }
  };
  await settle(100);
  expect(replay.problem.value?.kind).toBe("offline");
  isAway = false;
  await settle(5000);
  expect(replay.problem.value).toBeUndefined();
  now.mockRestore();
  replay.dispose();
});
