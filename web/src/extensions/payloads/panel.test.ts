import { describe, expect, it } from "vitest";
import { hexBytes, hexLines } from "./panel";

const text = (runs: readonly { readonly text: string }[]): string => runs.map((run) => run.text).join("");

describe("readable bytes", () => {
  it("are eight to a line with offset and letters", () => {
    const lines = hexLines(hexBytes("48656c6c6f2c20776f726c6400ff"), undefined);
    expect(lines.map(({ offset }) => offset)).toEqual(["0000", "0008"]);
    expect(lines.map(({ bytes }) => text(bytes))).toEqual(["48 65 6C 6C 6F 2C 20 77 ", "6F 72 6C 64 00 FF       "]);
    expect(lines.map(({ letters }) => text(letters))).toEqual(["Hello, w", "orld··"]);
    expect(lines.flatMap(({ bytes }) => bytes).some(({ changed }) => changed)).toBe(false);
  });

  it("mark what changed, also where a payload grew", () => {
    const [line] = hexLines(hexBytes("0102030405"), hexBytes("01ff03"));
    expect(line?.bytes.filter(({ changed }) => changed).map((run) => run.text)).toEqual(["02 ", "04 05 "]);
    expect(hexLines(hexBytes("0102"), hexBytes("0102"))[0]?.bytes.some(({ changed }) => changed)).toBe(false);
  });

  it("end at the first character that is not hex", () => {
    expect([...hexBytes("01zz02")]).toEqual([1]);
    expect(hexLines(hexBytes(""), undefined)).toEqual([]);
  });
});
