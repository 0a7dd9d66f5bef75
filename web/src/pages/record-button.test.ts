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
  headless: [],
  message: "",
  hint: "",
  op: "recorder",
  ...more,
});

it("an ended recording is reported with a link, whoever ended it", () => {
  expect(endedOf(state(true, { bytes: 900 }), state(false, { id: "" }))).toEqual({
    id: "yard",
    title: "yard",
  });
  expect(endedOf(state(true), state(false), ["MTi-630", "IMX-5", "IMX-5"])?.title).toBe("MTi-630 + IMX-5");
});

it("a running, failed or missing recording is not reported", () => {
  expect(endedOf(state(true), state(true))).toBeUndefined();
  expect(endedOf(state(true), state(false, { message: "The disk is full." }))).toBeUndefined();
  expect(endedOf(undefined, state(false))).toBeUndefined();
});
