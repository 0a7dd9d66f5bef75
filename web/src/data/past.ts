/**
 * Data of a server that has gone: samples, losses and events, kept until the same devices come back with the next run.
 *
 * Ids start at 1 again in every run of a server, and so do samples and events. So a device is recognised by its connection and
 * its identity, a channel by its name and columns, and the old data is numbered below everything new.
 */
import type { ChannelInfo, DeviceInfo, EventInfo } from "../wire/types";
import type { Loss, LossList } from "./losses";
import type { Ring } from "./ring-buffer";

/** A ring and its content, in the frame that the device sends. */
export interface HeldRange {
  readonly info: ChannelInfo;
  readonly ring: Ring;
}

/** Which of several devices on a shared line it is; "" for the first. */
const seatOf = ({ id, parent }: DeviceInfo): string => (parent === "" ? "" : id.slice(parent.length));

/** Whether it can be the same device; an unknown identity is not a contradiction. */
export function isSame(old: DeviceInfo, now: DeviceInfo): boolean {
  const agree = (a: string, b: string): boolean => a === "" || b === "" || a === b;
  return (
    old.source === now.source &&
    seatOf(old) === seatOf(now) &&
    agree(old.protocol, now.protocol) &&
    agree(old.serial_number, now.serial_number)
  );
}

const isAlike = (a: ChannelInfo, b: ChannelInfo): boolean =>
  a.name === b.name &&
  a.kind === b.kind &&
  a.frame === b.frame &&
  a.columns.length === b.columns.length &&
  a.columns.every(
    ({ name, dtype, unit }, c) =>
      name === b.columns[c]!.name && dtype === b.columns[c]!.dtype && unit === b.columns[c]!.unit,
  );

export class Past {
  /** New id → the device before. */
  readonly #known = new Map<string, DeviceInfo>();
  readonly #devices: DeviceInfo[];
  readonly #held: HeldRange[];
  readonly #losses: LossList;
  readonly #events: readonly EventInfo[];

  constructor(
    devices: readonly DeviceInfo[],
    held: readonly HeldRange[],
    losses: LossList,
    events: readonly EventInfo[],
  ) {
    this.#devices = [...devices];
    this.#held = [...held];
    this.#losses = losses;
    const above = 1 + (events.at(-1)?.seq ?? 0);
    this.#events = events.map((event) => ({ ...event, seq: event.seq - above }));
  }

  /** Devices of this list that have just come back, by their new ids. */
  meet(devices: readonly DeviceInfo[]): readonly string[] {
    const back: string[] = [];
    for (const device of devices) {
      if (this.#known.has(device.id)) continue;
      const alike = this.#devices.filter((old) => isSame(old, device));
      const old = alike.find(({ id }) => id === device.id) ?? alike[0];
      if (old === undefined) continue;
      this.#devices.splice(this.#devices.indexOf(old), 1);
      this.#known.set(device.id, old);
      back.push(device.id);
    }
    return back;
  }

  /** Devices that were matched wrongly. */
  mistaken(devices: readonly DeviceInfo[]): readonly string[] {
    const wrong = devices.filter((device) => !isSame(this.#known.get(device.id) ?? device, device)).map(({ id }) => id);
    for (const id of wrong) this.#known.delete(id);
    return wrong;
  }

  /** The ring that a channel continues, once; undefined if there is none. */
  ringFor(info: ChannelInfo): Ring | undefined {
    const old = this.#known.get(info.device);
    const at = this.#held.findIndex((held) => held.info.device === old?.id && isAlike(held.info, info));
    return this.#held.splice(at, at < 0 ? 0 : 1)[0]?.ring;
  }

  lossesOf(device: string): readonly Loss[] {
    return this.#losses.of(this.#known.get(device)?.id ?? "");
  }

  /** Events of a device, under its new name. */
  eventsOf(device: string): readonly EventInfo[] {
    const old = this.#known.get(device)?.id;
    return this.#events.filter((event) => event.device === old).map((event) => ({ ...event, device }));
  }

  /** Last arrival of any data of the device, unix s; NaN without data. Call it before its rings are handed over. */
  lastOf(device: string): number {
    const old = this.#known.get(device)?.id;
    return this.#held.reduce(
      (last, { info, ring }) =>
        info.device === old && !(ring.newest <= last) && ring.newest === ring.newest ? ring.newest : last,
      NaN,
    );
  }

  /** Release the memory of unclaimed data. */
  release(): void {
    for (const { ring } of this.#held.splice(0)) ring.release();
  }
}
