import { describe, expect, it } from "vitest";
import type { ChannelInfo, ColumnInfo } from "../wire/types";
import { channelInfo, columnInfo } from "../testing/fixtures";
import { valueGroups } from "./value-groups";

const column = (name: string, more: Partial<ColumnInfo> = {}): ColumnInfo => columnInfo({ name, ...more });
const channel = (name: string, kind: ChannelInfo["kind"], columns: ColumnInfo[]): ChannelInfo =>
  channelInfo({ name, kind, columns });

describe("groupsOf", () => {
  it("puts measured quantities first and groups single values at the end", () => {
    const groups = valueGroups([
      channel("Temperature", "scalar", [column("value", { unit: "°C" })]),
      channel("RateOfTurn", "vector", [
        column("x", { axis: "x", unit: "rad/s" }),
        column("y", { axis: "y", unit: "rad/s" }),
      ]),
      channel("GnssPvtData", "record", [column("lat"), column("fixtype"), column("Reserved1")]),
      channel("Acceleration", "vector", [column("x", { axis: "x", unit: "m/s²" })]),
      channel("GnssSatInfo", "table", [column("svId"), column("cno")]),
      channel("PacketCounter", "counter", [column("value")]),
    ]);
    expect(groups.map((group) => group.title)).toEqual(["Acceleration", "RateOfTurn", "Other values", "GnssPvtData"]);
    expect(groups[1]).toMatchObject({ unit: "rad/s" });
    expect(groups[2]?.rows.map((row) => row.label)).toEqual(["Temperature", "GnssSatInfo", "PacketCounter"]);
    expect(groups[2]?.rows[1]?.column).toBe(-1);
    expect(groups[3]?.rows.map((row) => row.label)).toEqual(["lat", "fixtype"]);
  });
  it("gives mean and spread of a quantity without axes, also of table columns", () => {
    const [group] = valueGroups([
      channel("gyro_z", "scalar", [column("value", { unit: "°/s" })]),
      channel("count", "scalar", [column("value", { dtype: "u4" })]),
    ]);
    expect(group?.rows.map(({ colour, unit }) => [colour, unit])).toEqual([
      ["n", "°/s"],
      ["", undefined],
    ]);
  });
  it("colours by axis, and grey without one", () => {
    const [group] = valueGroups([
      channel("Quaternion", "quaternion", [column("w", { axis: "w" }), column("x", { axis: "x" })]),
    ]);
    expect(group?.rows.map((row) => row.colour)).toEqual(["n", "x"]);
  });
});
