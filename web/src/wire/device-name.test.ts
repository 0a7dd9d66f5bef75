import { expect, test } from "vitest";
import { DEVICE } from "../testing/synthetic";
import { deviceInLink, distinctName, fullName, linkName, listName, writeName } from "./device-name";

const of = (id: string, serial: string, more = {}) => ({
  ...DEVICE,
  id,
  name: "MTi-630",
  serial_number: serial,
  key: serial ? `xbus-${serial}` : "/dev/ttyUSB0",
  ...more,
});
const left = of("1", "0080800006", { own_name: "left wheel" });
const right = of("2", "0080800009");
const unread = of("3", "");

test("two sensors of one product have different names", () => {
  const other = of("4", "0080800001");
  expect(distinctName(right, [right])).toBe("MTi-630");
  expect(distinctName(right, [right, other])).toBe("MTi-630 · 0080800009");
  expect(distinctName(left, [left, right])).toBe("left wheel");
  expect(fullName(left)).toBe("left wheel · MTi-630 · 0080800006");
  expect(listName(left)).toBe("left wheel · 0080800006");
  expect(fullName({ name: "IDTP device 102", serial_number: "102" })).toBe("IDTP device 102");
});

test("a link names the sensor, whatever its number in this run", () => {
  expect(linkName("2", [left, right])).toBe("xbus-0080800009");
  expect(deviceInLink("xbus-0080800009", [{ ...right, id: "7" }])?.id).toBe("7");
  expect(deviceInLink("xbus-0080800009", [left])).toBeUndefined();
  expect(deviceInLink(linkName("3", [unread]), [unread])).toBe(unread);
  expect(linkName("2", [right, { ...right, id: "5" }])).toBe("2");
});

test("a write names the sensor it is for, once its number is known", () => {
  expect(writeName("2", [left, right])).toBe("xbus-0080800009");
  expect(writeName("3", [unread])).toBe("3");
});
