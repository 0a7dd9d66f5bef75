import { expect, it } from "vitest";
import type { Channel } from "../data/channels";
import { TEXT } from "../texts/attitude";
import { attitudeHint } from "./panel";

const OF_FAMILY = "Stream INS 1.";
const of = (...groups: readonly string[]): Channel[] =>
  groups.map((group) => ({ info: { group } }) as unknown as Channel);

it("names outputs of the family for a device of the family alone", () => {
  expect(attitudeHint([], OF_FAMILY)).toBe(OF_FAMILY);
  expect(attitudeHint(of("INS 1", "UBX NAV-PVT"), OF_FAMILY)).toBe(OF_FAMILY);
  expect(attitudeHint(of("", "NMEA GNGGA"), OF_FAMILY)).toBe(OF_FAMILY);
});

it("names messages of a receiver for a receiver alone", () => {
  expect(attitudeHint(of("UBX NAV-PVT", "NMEA GNGGA"), OF_FAMILY)).toBe(TEXT.ubxAttitude);
  expect(attitudeHint(of("NMEA GNGGA", "NMEA GNRMC"), OF_FAMILY)).toBe(TEXT.nmeaAttitude);
});
