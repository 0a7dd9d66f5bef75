import { expect, it } from "vitest";
import { timesSeconds } from "./figure-columns";

/** As protocols/schema/units.py gives them. */
it.each([
  ["m/s²", "m/s³", "m/s"],
  ["°/s", "°/s²", "°"],
  ["1/s", "1/s²", ""],
  ["m", "m/s", "m·s"],
  ["", "1/s", "s"],
  ["s", "", "s²"],
  ["µT", "µT/s", "µT·s"],
  ["a.u.", "a.u./s", "a.u.·s"],
  ["°C", "°C/s", "°C·s"],
  ["m/s^2", "m/s³", "m/s"],
  ["%", "%/s", "%·s"],
])("the slope of %s is in %s, its integral in %s", (unit, slope, integral) => {
  expect([timesSeconds(unit, -1), timesSeconds(unit, 1)]).toEqual([slope, integral]);
});
