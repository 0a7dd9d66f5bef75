/** Rows of a frame: each part with its bytes, its meaning and the value on the wire. */
import { expect, test } from "vitest";
import { packetRows, fieldValue } from "./packet-dialog";

test("a part has its bytes, what they mean, and the value on the wire", () => {
  const rows = packetRows({
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

test("the part of the sample that was asked for is marked, of a computed one all that it is computed from", () => {
  const paths = ["time", "I.pqr.0", "I.pqr.1", "I.acc.0"];
  const frame = {
    hex: "00".repeat(4),
    spans: paths.map((path, offset) => ({ offset, size: 1, label: path, path })),
    fields: {},
  };
  const of = (channel: string, column: string, at: number) =>
    packetRows(frame, { name: "", value: "", message: "DID_IMU", channel, column, at })
      .filter(({ isSample }) => isSample)
      .map(({ words }) => words);
  expect(of("DID_IMU.I.pqr", "y", 1)).toEqual(["I.pqr.1"]);
  expect(of("DID_IMU.I.pqr", "norm", -1)).toEqual(["I.pqr.0", "I.pqr.1"]);
  expect(of("DID_IMU", "time", 0)).toEqual(["time"]); // a record: its columns are fields
  const whole = { ...frame, spans: [{ offset: 0, size: 4, label: "RateOfTurn", path: "RateOfTurn" }] };
  const sample = { name: "", value: "", message: "MTData2", channel: "RateOfTurn", column: "z", at: 2 };
  expect(packetRows(whole, sample)[0]?.isSample).toBe(true);
});

test("bytes of no frame are one part", () => {
  const [row, ...others] = packetRows({ hex: "00".repeat(40), spans: [], fields: {} });
  expect(others).toEqual([]);
  expect(row?.bytes).toMatch(/^(00 ){32}…$/);
});

test("values are found by paths whose names contain dots", () => {
  const fields = { "I.pqr": [1, 2, 3], I: { pqr: [7] }, rows: [{ rate: 5 }] };
  expect(fieldValue(fields, "I.pqr.2")).toBe(3);
  expect(fieldValue(fields, "rows.0.rate")).toBe(5);
  expect(fieldValue(fields, "rows.1.rate")).toBeUndefined();
});
