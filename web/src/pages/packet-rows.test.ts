/** Rows of a frame: each part with its bytes, its meaning and the value on the wire. */
import { expect, test } from "vitest";
import { rowsOf, valueOf } from "./packet-rows";

test("a part has its bytes, what they mean, and the value on the wire", () => {
  const rows = rowsOf({
    hex: "fa36001f3f800000c8",
    spans: [
      { offset: 0, size: 1, label: "preamble", path: "" },
      { offset: 1, size: 3, label: "MTData2", path: "" },
      { offset: 4, size: 4, label: "acc x = 9.81 m/s²", path: "I.acc.0" },
      { offset: 8, size: 1, label: "checksum", path: "" },
    ],
    fields: { "I.acc": [1, 2, 3] },
  });
  expect(rows.map(({ bytes }) => bytes)).toEqual(["FA", "36 00 1F", "3F 80 00 00", "C8"]);
  expect(rows[2]).toMatchObject({ offset: 4, raw: "1", isField: true });
  expect(rows[3]).toMatchObject({ raw: "", isField: false });
});

test("bytes of no frame are one part", () => {
  const [row, ...others] = rowsOf({ hex: "00".repeat(40), spans: [], fields: {} });
  expect(others).toEqual([]);
  expect(row?.bytes).toMatch(/^(00 ){32}…$/);
});

test("values are found by paths whose names contain dots", () => {
  const fields = { "I.pqr": [1, 2, 3], I: { pqr: [7] }, rows: [{ rate: 5 }] };
  expect(valueOf(fields, "I.pqr.2")).toBe(3);
  expect(valueOf(fields, "rows.0.rate")).toBe(5);
  expect(valueOf(fields, "rows.1.rate")).toBeUndefined();
});
