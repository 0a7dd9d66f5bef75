/** What is proposed in the place of a signal that a device has not. */
import { expect, it } from "vitest";
import type { Channel } from "../../data/channels";
import { likeNames } from "./proposals";

const channel = (device: string, name: string, title: string, unit: string, kind = "vector"): Channel =>
  ({
    info: { device, name, title, unit, kind, source: "", columns: [{ name: "x" }, { name: "y" }] },
  }) as unknown as Channel;
const CHANNELS = [
  channel("1", "RateOfTurn", "Rate of turn", "°/s"),
  channel("1", "Quaternion", "Quaternion", ""),
  channel("3", "DID_IMU.I.acc", "Acceleration", "m/s²"),
  channel("3", "DID_IMU.I.pqr", "Rate of turn", "°/s"),
  channel("3", "DID_INS_1.status", "Status", "", "status"),
];

it("a signal that the device has not is answered with its own of the same quantity", () => {
  expect(likeNames(["RateOfTurn.z"], "3", CHANNELS)).toEqual(["DID_IMU.I.pqr.z"]);
  expect(likeNames(["Quaternion"], "3", CHANNELS)).toEqual(["DID_IMU.I.acc", "DID_IMU.I.pqr"]); // none alike: all
  expect(likeNames(["nonsense"], "3", CHANNELS)).toEqual(["DID_IMU.I.acc", "DID_IMU.I.pqr"]);
});
