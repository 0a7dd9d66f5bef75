import { expect, it } from "vitest";
import type { RecorderState } from "../wire/types";
import { endedOf } from "./record-button";

const state = (running: boolean, more: Partial<RecorderState> = {}): RecorderState => ({
  running,
  id: "yard",
  title: "",
  devices: [],
  started: running ? 100 : null,
  bytes: 5,
  behind_s: 0,
  free: null,
  seconds_left: null,
  message: "",
  hint: "",
  op: "recorder",
  ...more,
});

it("a recording that ended is told with what leads to it, whoever ended it", () => {
  expect(endedOf(state(true, { bytes: 900 }), state(false, { id: "" }), 131)).toEqual({
    id: "yard",
    title: "yard",
    duration: 31,
    bytes: 900,
  });
  expect(endedOf(state(true), state(false), 131, ["MTi-630", "IMX-5", "IMX-5"])?.title).toBe("MTi-630 + IMX-5");
});

it("one that goes on, failed, or was never there is not", () => {
  expect(endedOf(state(true), state(true), 131)).toBeUndefined();
  expect(endedOf(state(true), state(false, { message: "The disk is full." }), 131)).toBeUndefined();
  expect(endedOf(undefined, state(false), 131)).toBeUndefined();
});
