import { describe, expect, it } from "vitest";
import type { ChannelInfo } from "../../wire/types";
import { choiceWords, titlesOf, labelWords } from "./labels";

describe("texts", () => {
  it("writes names as in the documents", () => {
    const names = [
      "ClipAccX",
      "HDG_ALIGN_FINE",
      "FLAGS_FIX_OK",
      "SOLUTION",
      "RTK_ERR_BASE",
      "FLAGS_GPS1_RTK_POSITION_VALID",
      "X",
    ];
    const said = [
      "Clip acc X",
      "Heading align fine",
      "Fix OK",
      "Solution",
      "RTK error base",
      "RTK position valid",
      "X",
    ];
    expect(names.map(labelWords).map((text) => text.toLowerCase())).toEqual(said.map((text) => text.toLowerCase()));
  });
  it("writes abbreviations in their usual case", () => {
    expect(["RtkStatus", "GnssFix", "Selftest", "insStatus"].map(labelWords)).toEqual([
      "RTK status",
      "GNSS fix",
      "Self-test",
      "INS status",
    ]);
  });
  it("uses the usual names of satellite systems", () => {
    expect(["GPS", "QZS", "GAL", "BDS", "GLO", "SBS"].map(labelWords)).toEqual([
      "GPS",
      "QZSS",
      "Galileo",
      "BeiDou",
      "GLONASS",
      "SBAS",
    ]);
  });
  it("reads choices in the middle of a sentence", () => {
    expect(["RTK_FIX", "NONE", "3D", "no RTK"].map(choiceWords)).toEqual(["RTK fix", "none", "3D", "no RTK"]);
  });
});

describe("titlesOf", () => {
  it("names the message only where it is needed", () => {
    const info = (title: string, group: string): ChannelInfo =>
      ({ title, group, name: `${group}.x` }) as unknown as ChannelInfo;
    const all = [info("Velocity", "INS 1"), info("Velocity", "GPS1 VEL"), info("Position", "INS 1")];
    expect(all.map(titlesOf(all))).toEqual(["Velocity · INS 1", "Velocity · GPS1 VEL", "Position"]);
  });
});
