import { expect, it } from "vitest";
import { chipsOf, rowOf, spaced, spelled } from "./frame-chips";

const frame = {
  name: "SetOutputConfiguration",
  hex: "faffc00840200190c0200064d5",
  spans: [
    { offset: 0, size: 2, label: "preamble, bus", path: "" },
    { offset: 2, size: 1, label: "Set…", path: "" },
    { offset: 3, size: 1, label: "8 B", path: "" },
    { offset: 4, size: 2, label: "Acceleration", path: "outputs.0.data_identifier" },
    { offset: 6, size: 2, label: "400 Hz", path: "outputs.0.output_frequency" },
    { offset: 8, size: 2, label: "Magnetic field", path: "outputs.1.data_identifier" },
    { offset: 10, size: 2, label: "100 Hz", path: "outputs.1.output_frequency" },
    { offset: 12, size: 1, label: "checksum", path: "" },
  ],
};

it("groups the bytes of a row, separately from the envelope", () => {
  expect(chipsOf(frame).map(({ bytes, words, path }) => [bytes, words, path])).toEqual([
    ["FA FF", "preamble, bus", ""],
    ["C0", "Set…", ""],
    ["08", "8 B", ""],
    ["40 20 01 90", "Acceleration · 400 Hz", "outputs.0"],
    ["C0 20 00 64", "Magnetic field · 100 Hz", "outputs.1"],
    ["D5", "checksum", ""],
  ]);
});

it("spells one row out", () => {
  expect(spelled(frame, "outputs.1")).toEqual([
    { bytes: "C0 20", words: "Magnetic field" },
    { bytes: "00 64", words: "100 Hz" },
  ]);
});

it("distinguishes rows from fields with dots in their names", () => {
  expect(["outputs.3.rate", "wheelConfig.bits", "words.0", "roll"].map(rowOf)).toEqual([
    "outputs.3",
    "wheelConfig.bits",
    "words.0",
    "roll",
  ]);
  expect(spaced("aabbcc", 2)).toBe("AA BB …");
});
