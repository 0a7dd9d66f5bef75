import { expect, it } from "vitest";
import { paceWords, streamed, streamRows } from "./streams";
import type { StreamChoice } from "./types";

const choice = (did: number, source_ms: number): StreamChoice => ({
  did,
  name: `DID_${did}`,
  title: `Set ${did}`,
  group: "",
  size: 80,
  rmc_bit: 0,
  source_ms,
  basic: true,
  doc: "",
});
const CHOICES = [choice(4, 7), choice(13, 200), choice(119, 0)];

it("reads periods as rates", () => {
  expect(CHOICES.map((one) => paceWords(one, 1))).toEqual(["143 Hz", "5.0 Hz", "native rate"]);
  expect(paceWords(CHOICES[0], 10)).toBe("14.3 Hz");
});

it("switches streams on and off, and gives the previous ones", () => {
  const before = [{ did: 4, period: 1, size: 0 }];
  const rows = streamRows(CHOICES, before, before);
  const slower = streamed(before, rows[0]!, 5, before[0]!);
  expect(streamRows(CHOICES, slower, before)[0]?.was).toBe("was 143 Hz");
  const more = streamed(slower, rows[1]!, 1, before[0]!);
  expect(more).toEqual([
    { did: 4, period: 5, size: 0 },
    { did: 13, period: 1, size: 0, source_ms: 200 },
  ]);
  expect(streamed(more, streamRows(CHOICES, more, before)[0]!, undefined, before[0]!)).toEqual([
    { did: 13, period: 1, size: 0, source_ms: 200 },
  ]);
});

it("keeps a stream that the table does not know", () => {
  expect(streamRows(CHOICES, [{ did: 500, period: 2 }], []).at(-1)).toMatchObject({
    title: "Not in the table",
    place: 0,
    was: "was off",
  });
});

it("shows the measured rate in preference to the table's", () => {
  const entries = [{ did: 4, period: 2, source_ms: 16 }];
  expect(streamRows(CHOICES, entries, entries).map((row) => paceWords(row.choice, row.period))).toEqual([
    "31 Hz",
    "5.0 Hz",
    "native rate",
  ]);
  const slower = [{ did: 4, period: 4, source_ms: 16 }];
  expect(streamRows(CHOICES, slower, entries)[0]?.was).toBe("was 31 Hz");
});
