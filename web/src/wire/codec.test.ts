import { describe, expect, it, test } from "vitest";
import frames from "../../../tests/golden/wire/frames.json";
import { decode } from "./codec";
import { HEADER } from "./frame";
import type { Dtype } from "./types";

interface Golden {
  readonly what: string;
  readonly channel: number;
  readonly sequence: number;
  readonly now: number;
  readonly history: boolean;
  readonly dropped: number;
  readonly dtypes: readonly Dtype[];
  readonly columns: readonly (readonly (number | string | null)[])[];
  readonly hex: string;
}

const golden = frames.frames as unknown as readonly Golden[];

function bytes(hex: string): Uint8Array<ArrayBuffer> {
  return Uint8Array.from(hex.match(/../g) ?? [], (pair) => parseInt(pair, 16));
}
const dtypesOf = (channel: number): readonly Dtype[] | undefined =>
  golden.find((entry) => entry.channel === channel)?.dtypes;
const first = golden[0]!;

describe("frames that Python wrote", () => {
  test.each(golden)("$what", (entry) => {
    const { frames, problem } = decode(bytes(entry.hex).buffer, dtypesOf);
    expect(problem).toBeUndefined();
    expect(frames).toHaveLength(1);
    const frame = frames[0]!;
    expect(frame).toMatchObject({
      channel: entry.channel,
      sequence: entry.sequence,
      now: entry.now,
      history: entry.history,
      dropped: entry.dropped,
    });
    const plain = [frame.arrival, frame.time, ...frame.columns].map((column) =>
      Array.from(column as ArrayLike<number | bigint>, (v) =>
        typeof v === "bigint" ? String(v) : Number.isNaN(v) ? null : v,
      ),
    );
    expect(plain).toEqual(entry.columns);
  });

  it("reads several frames of one message, as views of that message", () => {
    const whole = bytes(golden.map(({ hex }) => hex).join(""));
    const { frames, problem } = decode(whole.buffer, dtypesOf);
    expect(problem).toBeUndefined();
    expect(frames.map(({ channel }) => channel)).toEqual(golden.map(({ channel }) => channel));
    for (const frame of frames)
      for (const column of [frame.arrival, ...frame.columns]) expect(column.buffer).toBe(whole.buffer);
  });
});

describe("an inconsistent message", () => {
  const broken = (change: (data: DataView) => void): string | undefined => {
    const data = bytes(first.hex);
    change(new DataView(data.buffer));
    return decode(data.buffer, dtypesOf).problem;
  };

  it.each([
    ["another opcode", (data: DataView) => data.setUint8(HEADER.opcode, 9), /opcode 9/],
    ["a size past the end", (data: DataView) => data.setUint32(HEADER.size, 8000, true), /exceeds the/],
    ["a size below the header", (data: DataView) => data.setUint32(HEADER.size, 16, true), /frame length of 16 B/],
    ["an odd size", (data: DataView) => data.setUint32(HEADER.size, 81, true), /frame length of 81 B/],
    ["too many samples", (data: DataView) => data.setUint32(HEADER.n, 0xffff_ffff, true), /4294967295 samples/],
    ["one sample less", (data: DataView) => data.setUint32(HEADER.n, 1, true), /need/],
    [
      "another number of columns",
      (data: DataView) => data.setUint16(HEADER.columns, 4, true),
      /5 columns, the frame has 4/,
    ],
    ["an unknown channel", (data: DataView) => data.setUint32(HEADER.channel, 77, true), /not advertised/],
  ])("names %s", (_, change, words) => expect(broken(change)).toMatch(words));

  it("keeps the frames before the fault", () => {
    const { frames, problem } = decode(bytes(`${first.hex}0102030405060708`).buffer, dtypesOf);
    expect(frames).toHaveLength(1);
    expect(problem).toMatch(/at byte \d+, 8 B left/);
  });

  it("survives every cut and every flipped byte", () => {
    const good = bytes(golden.map(({ hex }) => hex).join(""));
    for (let n = 0; n < good.length; n++) {
      expect(() => decode(good.slice(0, n).buffer, dtypesOf)).not.toThrow();
      const flipped = good.slice();
      flipped[n] = flipped[n]! ^ 0xff;
      expect(() => decode(flipped.buffer, dtypesOf)).not.toThrow();
    }
  });
});
