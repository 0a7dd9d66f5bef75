import { expect, it } from "vitest";
import type { ColumnInfo } from "../wire/types";
import { FORMATS, formatsOf, sizeOf } from "./exporting";
import type { ExportFormat } from "./types";

const device = (protocol: string) => ({ id: "1", name: "", protocol, product: "", serial_number: "", messages: 0, lost: 0, rejects: 0 });

it("offers a vendor's format where its devices are", () => {
  const names = (protocol: string): readonly string[] => formatsOf({ devices: [device(protocol)] }).map(({ name }) => name);
  expect(names("xbus")).toContain("mtb");
  expect(names("isb")).toContain("raw");
  expect(names("idtp")).not.toContain("mtb");
  expect(names("idtp")).toContain("bytes");
});

it("offers every format that the server writes", () => {
  const all: Readonly<Record<ExportFormat, true>> = { csv: true, "csv-aligned": true, parquet: true, mcap: true, rrd: true, mtb: true, raw: true, bytes: true };
  expect(FORMATS.map(({ name }) => name).sort()).toEqual(Object.keys(all).sort());
});

it("says about how large, by range and channels", () => {
  const columns = [1, 2, 3].map(() => ({ dtype: "f4" })) as unknown as readonly ColumnInfo[];
  const detail = { longest_s: { 1: 0.01, 2: 0.01 }, channels: [{ id: 1, kind: "vector" as const, columns }, { id: 2, kind: "vector" as const, columns }] };
  const whole = sizeOf("csv", { size: 1, duration: 100 }, detail, 100, undefined);
  expect(whole).toBeGreaterThan(1e6);
  expect(sizeOf("csv", { size: 1, duration: 100 }, detail, 50, [1])).toBeCloseTo(whole / 4, -3);
  expect(sizeOf("parquet", { size: 1, duration: 100 }, detail, 100, undefined)).toBeLessThan(whole);
  expect(sizeOf("bytes", { size: 1000, duration: 100 }, detail, 50, [1])).toBe(500);
});
