import { expect, it } from "vitest";
import type { SnapshotInfo } from "../../wire/form-types";
import { listed, refFor, snapshotTitle } from "./sides";

const info = (title: string, taken: number, part: Partial<SnapshotInfo> = {}): SnapshotInfo => ({
  name: `${taken}`,
  title,
  taken,
  reason: "",
  product: "",
  serial_number: "",
  firmware: "",
  settings: 1,
  missing: 0,
  pinned: false,
  readable: true,
  ...part,
});

it("keeps the first and named snapshots in the list", () => {
  const writes = [9, 8, 7, 6, 5, 4, 3].map((taken) => info("Before this change", taken));
  const all = [...writes, info("New mast", 2, { pinned: true }), info("First contact", 1, { pinned: true })];
  expect(listed(all, 5).map(({ taken }) => taken)).toEqual([9, 8, 7, 6, 5, 2, 1]);
});

it("distinguishes snapshots with the same title", () => {
  expect(snapshotTitle({ title: "Before this change", reason: "Before writing Output configuration." })).toBe(
    "Before writing Output configuration",
  );
  expect(snapshotTitle({ title: "Before this change", reason: "new mast" })).toBe("Before this change: new mast");
  expect(snapshotTitle({ title: "First contact", reason: "" })).toBe("First contact");
});

it("names a side for another device than the one whose page it is", () => {
  expect(refFor("2026-a", "", "1", "2")).toMatchObject({ side: "snapshot", snapshot: "2026-a", device: "1" });
  expect(refFor("2026-a", "", "1", "1")).toMatchObject({ side: "snapshot", device: "" });
  expect(refFor("device", "", "1", "2")).toMatchObject({ side: "other", device: "1" });
  expect(refFor("device", "", "1", "1")).toBeUndefined();
  expect(refFor("~other:2", "", "1", "2")).toBeUndefined();
  expect(refFor("~file", "imuscope: 1", "1", "2")).toMatchObject({ side: "text", text: "imuscope: 1" });
});
