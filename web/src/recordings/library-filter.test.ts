import { expect, it } from "vitest";
import {
  bytes,
  chosen,
  dateWords,
  daysLeft,
  deviceName,
  namesOfDevices,
  distinctNames,
  flaw,
  recordedLosses,
  heardIn,
  inCategory,
  knownDevices,
  withReceiving,
  length,
  recordingMatches,
  messagesOf,
  countedValues,
  recordingTitle,
  wordsOf,
} from "./library-filter";
import type { RecordingDetail, RecordingInfo } from "../wire/recording-types";

const one = (part: Partial<RecordingInfo> = {}): RecordingInfo => ({
  id: "a",
  title: "Yard loop",
  file: "a.mcap",
  format: "mcap",
  size: 1e6,
  started: 1_763_732_640,
  duration: 60,
  devices: [
    {
      id: "1",
      name: "MTi-630",
      protocol: "xbus",
      product: "MTi-630 AHRS",
      serial_number: "04F9",
      messages: 10,
      lost: 0,
      rejects: 0,
      simulated: false,
      counts_losses: true,
    },
  ],
  tags: ["yard"],
  notes: "three laps",
  pinned: false,
  recording: false,
  opened: true,
  damaged: "",
  remark: "",
  markers: 0,
  read: true,
  motion: "|a|",
  thumbnail: [],
  losses: [],
  marks: [],
  deleted: null,
  ...part,
});
const all = { category: "all", device: "", tag: "", query: "" } as const;

it("finds by any words of title, notes, tags, devices and date", () => {
  for (const query of ["yard", "LAPS three", "04f9", "mti-630 yard", "21 nov", "2025-11-21", ""])
    expect(recordingMatches(one(), wordsOf(query)), query).toBe(true);
  expect(recordingMatches(one(), ["yard", "crane"])).toBe(false);
});

it("separates deleted recordings", () => {
  const list = [one(), one({ id: "b", deleted: 5, pinned: true })];
  expect(chosen(list, all).map(({ id }) => id)).toEqual(["a"]);
  expect(chosen(list, { ...all, category: "pinned" })).toEqual([]);
  expect(chosen(list, { ...all, category: "deleted" }).map(({ id }) => id)).toEqual(["b"]);
  expect(chosen(list, { ...all, device: "MTi-630 04F9", tag: "yard" })).toHaveLength(1);
  expect(daysLeft(0, 6.5 * 86_400)).toBe(1);
});

it("puts the worst first", () => {
  const lossy = one({ devices: one().devices.map((device) => ({ ...device, lost: 72, rejects: 3 })) });
  expect(flaw(lossy)).toEqual({ tone: "warn", words: "72 lost" });
  expect(flaw({ ...lossy, damaged: "The file ends at 08:51." }).tone).toBe("bad");
  expect(flaw(one({ opened: true })).words).toBe("none");
  const unread = one({ opened: false, read: false, losses: [0.5] });
  expect(flaw(unread).words).toBe("not read yet");
  expect([inCategory(unread, "lossy"), inCategory(unread, "unread")]).toEqual([false, true]);
  const uncounted = one().devices.map((device) => ({ ...device, counts_losses: false }));
  expect(flaw(one({ devices: uncounted })).words).toBe("none known"); // a table: nothing tells what is missing
  expect([recordedLosses(lossy), recordedLosses(unread)]).toEqual(["72", "not read yet"]);
});

it("writes lengths and sizes", () => {
  expect([length(2832), length(36_004), length(1312.3149, 3), length(null), length(59.9999, 3)]).toEqual([
    "47:12",
    "10:00:04",
    "21:52.314",
    "—",
    "00:59.999",
  ]);
  expect(bytes(154.3e6)).toEqual({ value: "154.3", unit: "MB" });
  expect(countedValues(["a", "b", "b"])).toEqual([
    ["b", 2],
    ["a", 1],
  ]);
});

it("names an untitled recording after its note, else by date and what was driven, else as its file", () => {
  const untitled = one({ id: "20251121T134400Z-MTi-630", title: "", notes: "" });
  expect(
    [one(), one({ title: "", notes: "three laps\nof the yard" }), untitled, one({ title: "a", notes: "" })].map(
      recordingTitle,
    ),
  ).toEqual(["Yard loop", "three laps", "21 Nov 2025, 13:44 · MTi-630", "a"]);
});

it("has no name twice in a list", () => {
  const untitled = one({ id: "20251121T134400Z-MTi-630", title: "", notes: "" });
  const list = [untitled, { ...untitled, started: 1_763_732_645 }, { ...untitled, file: "b.mcap" }, one()];
  expect([...distinctNames(list).values()]).toEqual([
    "21 Nov 2025, 13:44 · MTi-630 · 13:44:00 · a.mcap",
    "21 Nov 2025, 13:44 · MTi-630 · 13:44:05",
    "21 Nov 2025, 13:44 · MTi-630 · 13:44:00 · b.mcap",
    "Yard loop",
  ]);
});

it("shows no message count before it is known", () => {
  const uncounted = { ...one().devices[0]!, messages: null };
  expect([messagesOf(one()), messagesOf(one({ devices: [uncounted] }))]).toEqual([10, undefined]);
  expect(withReceiving(one({ devices: [uncounted] })).devices).toHaveLength(1);
});

it("a device without data is in no recording name and no filter", () => {
  const silent = {
    id: "2",
    name: "ttyUSB9",
    protocol: "",
    product: "",
    serial_number: "",
    messages: 0,
    lost: 0,
    rejects: 0,
    simulated: false,
    counts_losses: true,
  };
  const info = one({ title: "", devices: [...one().devices, silent] });
  expect(namesOfDevices(withReceiving(info))).toBe("MTi-630");
  expect(withReceiving(info).devices.map(deviceName)).toEqual(["MTi-630 04F9"]);
  expect(withReceiving(one({ devices: [silent] })).devices).toHaveLength(1); // a recording without data keeps its only device
  const detail = {
    info,
    devices: [{ id: "1" }, { id: "2" }],
    channels: [{ device: "1" }],
  } as unknown as RecordingDetail;
  expect(heardIn(detail).devices.map(({ id }) => id)).toEqual(["1"]);
});

it("a table has no device that is named after its file", () => {
  const [device] = one().devices;
  const table = { ...device!, protocol: "", product: "", serial_number: "" };
  for (const name of ["walk", "walk.csv"]) {
    const info = one({ id: "walk", title: "walk", notes: "", devices: [{ ...table, name }] });
    expect([knownDevices(info), recordingTitle(info)]).toEqual([[], "walk"]);
    expect(chosen([info], { ...all, device: name })).toEqual([]);
  }
  expect(knownDevices(one({ id: "walk", devices: [{ ...table, name: "left wheel" }] }))).toHaveLength(1);
  expect(knownDevices(one({ id: "MTi-630" }))).toHaveLength(1); // a file that is named after its device
});

it("shows the serial number of a device once", () => {
  const device = {
    id: "1",
    name: "IDTP device 102",
    protocol: "idtp",
    product: "",
    serial_number: "102",
    messages: 0,
    lost: 0,
    rejects: 0,
    simulated: false,
    counts_losses: true,
  };
  expect(deviceName(device)).toBe("IDTP device 102");
  expect(deviceName({ ...device, name: "IMX-5" })).toBe("IMX-5 102");
  expect(deviceName({ ...device, name: "IMX-5", serial_number: "5" })).toBe("IMX-5 5"); // the 5 in its name belongs to the product
  expect(deviceName({ ...device, name: "102" })).toBe("102");
});

it("writes the year of a date of another one", () => {
  const now = new Date();
  const thisYear = Date.UTC(now.getUTCFullYear(), 0, 2, 3, 4) / 1000;
  expect(dateWords(thisYear)).toBe("2 Jan, 03:04");
  expect(dateWords(Date.UTC(2017, 1, 8, 13, 5) / 1000)).toBe("8 Feb 2017, 13:05");
});
