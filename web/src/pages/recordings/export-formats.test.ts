import { expect, it } from "vitest";
import type { ExportCapability } from "../../wire/capability-types";
import { formatsOf, sizeOf } from "./export-dialog";

const format = (part: Partial<ExportCapability> & { readonly name: string }): ExportCapability => ({
  title: part.name,
  words: "",
  suffix: ".out",
  single: false,
  protocol: "",
  takes_units: false,
  per_byte: 1,
  ...part,
});
const CSV = format({ name: "csv", per_byte: 1.4 });
const PARQUET = format({ name: "parquet", per_byte: 1.3 });
const BYTES = format({ name: "bytes", single: true });
const LOG = format({ name: "log", single: true, protocol: "one" });

const device = (protocol: string) => ({
  id: "1",
  name: "",
  protocol,
  product: "",
  serial_number: "",
  messages: 0,
  lost: 0,
  rejects: 0,
  simulated: false,
  counts_losses: true,
});

it("offers a vendor's format where its devices are", () => {
  const names = (protocol: string): readonly string[] =>
    formatsOf([CSV, LOG, BYTES], { devices: [device(protocol)] }).map(({ name }) => name);
  expect(names("one")).toEqual(["csv", "log", "bytes"]);
  expect(names("other")).toEqual(["csv", "bytes"]);
});

it("shows the measured size, and an estimate before", () => {
  const [info, measured] = [
    { size: 1000, duration: 100 },
    { sizes: { csv: 420, parquet: 300 }, devices: { 1: 700, 2: 90 } },
  ];
  const of = (one: ExportCapability, from: typeof measured | undefined) => sizeOf(one, info, 50, "2", from);
  expect(of(CSV, measured)).toEqual({ bytes: 420, measured: true });
  expect(of(BYTES, measured)).toEqual({ bytes: 90, measured: true });
  expect(of(format({ name: "unmeasured" }), measured).measured).toBe(false);
  expect(of(BYTES, undefined)).toEqual({ bytes: 500, measured: false });
  expect(of(CSV, undefined).bytes).toBeGreaterThan(of(PARQUET, undefined).bytes);
});
