/** Names of devices: on the page, and in links. A link names the sensor, not the number of its source in this run. */
import type { DeviceInfo } from "./types";

type Named = Pick<DeviceInfo, "name" | "serial_number"> & Partial<Pick<DeviceInfo, "own_name">>;

/** The name that people gave it, else its product. */
export const shortName = ({ own_name, name }: Named): string => own_name || name;

/** All that tells it from others: "left wheel · MTi-630 · 0080800006". */
export function fullName({ own_name, name, serial_number: serial }: Named): string {
  return [own_name, name, name.includes(serial) ? "" : serial].filter(Boolean).join(" · ");
}

/** For a list to choose from: "left wheel · 0080800006". */
export const listName = (device: Named): string => fullName({ ...device, name: shortName(device), own_name: "" });

/** As short as can be without being another's: with the serial number if two have one name. */
export function distinctName(device: DeviceInfo, all: readonly DeviceInfo[]): string {
  const name = shortName(device);
  const isAlone = all.filter((one) => shortName(one) === name).length < 2;
  return isAlone || device.serial_number === "" || name.includes(device.serial_number)
    ? name
    : `${name} · ${device.serial_number}`;
}

/** What a link calls a device: its key, unless several have it. */
export function linkName(id: string, all: readonly DeviceInfo[]): string {
  const key = all.find((one) => one.id === id)?.key ?? "";
  return key !== "" && all.filter((one) => one.key === key).length === 1 ? key : id;
}

/** The device that a link names, by its key or its id. */
export function deviceInLink(name: string, all: readonly DeviceInfo[]): DeviceInfo | undefined {
  return all.find(({ id }) => id === name) ?? all.find(({ key }) => key === name);
}

/**
 * What a request calls a device that it writes to: the key of the sensor, so that another one at its port is refused; the id while its
 * serial number is not known.
 */
export function writeName(id: string, all: readonly DeviceInfo[]): string {
  const isKnown = (all.find((one) => one.id === id)?.serial_number ?? "") !== "";
  const name = isKnown ? linkName(id, all) : id;
  return name.includes("/") ? id : name;
}
