// @vitest-environment happy-dom
import { beforeEach, expect, it } from "vitest";
import type { RecordingInfo } from "../wire/recording-types";
import { recordingTitle } from "./library-filter";
import {
  type LIBRARY_COLUMNS,
  sortRecordings,
  sortedBy,
  storedView,
  storeView,
  USUAL,
  withLibraryColumn,
} from "./library-view";

beforeEach(() => localStorage.clear());

const info = (id: string, more: Partial<RecordingInfo>): RecordingInfo =>
  ({
    id,
    title: id,
    file: `${id}.mcap`,
    notes: "",
    devices: [],
    tags: [],
    damaged: "",
    read: true,
    losses: [],
    started: null,
    ...more,
  }) as unknown as RecordingInfo;

it("sorts by each column in both directions, with unknown values last", () => {
  const list = [
    info("run 2", { started: 5, size: 9 }),
    info("run 10", { started: null, size: 7 }),
    info("a", { started: 8, size: 8 }),
  ];
  const ids = (by: (typeof LIBRARY_COLUMNS)[number]["name"], isDescending: boolean): string =>
    sortRecordings(list, { by, isDescending }, recordingTitle)
      .map(({ id }) => id)
      .join();
  expect([ids("recorded", true), ids("recorded", false)]).toEqual(["a,run 2,run 10", "run 2,a,run 10"]);
  expect([ids("name", false), ids("size", true)]).toEqual(["a,run 2,run 10", "run 2,a,run 10"]);
  const unread = [info("x", { read: false, opened: false }), info("bad", { damaged: "cut" }), info("good", {})];
  expect(sortRecordings(unread, { by: "loss", isDescending: true }, recordingTitle).map(({ id }) => id)).toEqual([
    "bad",
    "good",
    "x",
  ]);
});

it("keeps order and columns in the browser, and ignores what is no view", () => {
  expect(storedView()).toEqual(USUAL);
  const view = withLibraryColumn(sortedBy(sortedBy(USUAL, "size"), "size"), "tags", false);
  storeView(view);
  expect(storedView()).toEqual(view);
  expect([view.by, view.isDescending, view.columns?.includes("tags"), view.columns?.includes("name")]).toEqual([
    "size",
    false,
    false,
    true,
  ]);
  for (const text of ["{", "7", '{"by":"colour","isDescending":true,"columns":["colour"]}']) {
    localStorage.setItem("imuscope.library", text);
    expect(storedView()).toEqual(USUAL);
  }
});
