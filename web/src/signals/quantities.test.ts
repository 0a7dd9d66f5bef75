import { describe, expect, it } from "vitest";
import { columnWords, searchWords, quantityWords } from "./quantities";

const found = (search: string, name: string, title: string, column: string, at = 0): boolean => {
  const all = `${name} ${title} ${column} ${quantityWords({ name, title })} ${columnWords({ name, title }, column, at)}`;
  return searchWords(search).every((word) => all.toLowerCase().includes(word));
};

describe.each(["rate of turn z", "gyro z", "angular velocity", "pqr[2]", "RateOfTurn"])("%s", (search) => {
  it.each([
    ["RateOfTurn", "Rate of turn"],
    ["Imu/RateOfTurn", "Rate of turn"],
  ])("finds %s", (name, title) => {
    expect(found(search, name, title, "z", 2)).toBe(true);
    expect(found(search, "Acceleration", "Acceleration", "z", 2)).toBe(false);
  });
});

it("what only sounds alike is not found", () => {
  expect(found("accelerometer", "FreeAcceleration", "Free acceleration", "x")).toBe(false);
  expect(found("accelerometer", "Gnss/Accuracy", "Horizontal accuracy", "x")).toBe(false);
  expect(found("speed", "Velocity", "Velocity", "u")).toBe(true);
  expect(found("[1]", "Velocity", "Velocity", "y", 1)).toBe(true);
  expect(found("[1]", "Velocity", "Velocity", "x", 0)).toBe(false);
});
