import { expect, it } from "vitest";
import { FORMATS, formatsOf, sizeOf } from "./export-formats";
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

it("says the size that was measured, and before that a rough one", () => {
  const [info, measured] = [{ size: 1000, duration: 100 }, { sizes: { csv: 420, parquet: 300 }, devices: { 1: 700, 2: 90 } }];
  const of = (name: ExportFormat, from: typeof measured | undefined) => sizeOf(FORMATS.find((format) => format.name === name)!, info, 50, "2", from);
  expect(of("csv", measured)).toEqual({ bytes: 420, measured: true });
  expect(of("bytes", measured)).toEqual({ bytes: 90, measured: true });
  expect(of("rrd", measured).measured).toBe(false);
  expect(of("bytes", undefined)).toEqual({ bytes: 500, measured: false });
  expect(of("csv", undefined).bytes).toBeGreaterThan(of("parquet", undefined).bytes);
});
