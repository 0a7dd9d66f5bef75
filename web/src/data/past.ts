/**
 * What the page held of a server that has gone: its samples, losses and events, until the same devices come back with the next one.
 *
 * Ids count from 1 again in every run of a server, and so do samples and events. So a device is known again by where it is connected
 * and what it says it is; a channel by its name and columns; and what is handed over is numbered below everything new.
 */
import type { ChannelInfo, DeviceInfo, EventInfo } from "../wire/types";
import { type Loss, LossBook } from "./losses";
import type { Ring } from "./ring-buffer";

/** A ring and what is in it, in the frame that the device sends. */
export interface Held {
  readonly info: ChannelInfo;
  readonly ring: Ring;
}

/** Of a device on a line that several share: which of them it is; "" of the first. */
const seatOf = ({ id, parent }: DeviceInfo): string => (parent === "" ? "" : id.slice(parent.length));

/** Can it be the same device? What one of them has not said yet is no contradiction. */
export function isSame(old: DeviceInfo, now: DeviceInfo): boolean {
  const agree = (a: string, b: string): boolean => a === "" || b === "" || a === b;
  return old.source === now.source && seatOf(old) === seatOf(now) && agree(old.protocol, now.protocol) && agree(old.serial_number, now.serial_number);
}

const isAlike = (a: ChannelInfo, b: ChannelInfo): boolean =>
  a.name === b.name && a.kind === b.kind && a.frame === b.frame && a.columns.length === b.columns.length && a.columns.every(({ name, dtype, unit }, c) => name === b.columns[c]!.name && dtype === b.columns[c]!.dtype && unit === b.columns[c]!.unit);

export class Past {
  /** What it is now called → what it was. */
  readonly #known = new Map<string, DeviceInfo>();
  readonly #devices: DeviceInfo[];
  readonly #held: Held[];
  readonly #losses: LossBook;
  readonly #events: readonly EventInfo[];

  constructor(devices: readonly DeviceInfo[], held: readonly Held[], losses: LossBook, events: readonly EventInfo[]) {
    this.#devices = [...devices];
    this.#held = [...held];
    this.#losses = losses;
    const above = 1 + (events.at(-1)?.seq ?? 0);
    this.#events = events.map((event) => ({ ...event, seq: event.seq - above }));
  }

  /** Devices of this list that have come back just now, by their new ids. */
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

  /** Devices that turned out to be others than they were taken for. */
  mistaken(devices: readonly DeviceInfo[]): readonly string[] {
    const wrong = devices.filter((device) => !isSame(this.#known.get(device.id) ?? device, device)).map(({ id }) => id);
    for (const id of wrong) this.#known.delete(id);
    return wrong;
  }

  /** The ring that goes on with a channel, once; undefined where there is none. */
  ringFor(info: ChannelInfo): Ring | undefined {
    const old = this.#known.get(info.device);
    const at = this.#held.findIndex((held) => held.info.device === old?.id && isAlike(held.info, info));
    return this.#held.splice(at, at < 0 ? 0 : 1)[0]?.ring;
  }

  lossesOf(device: string): readonly Loss[] {
    return this.#losses.of(this.#known.get(device)?.id ?? "");
  }

  /** Its events, under its new name. */
  eventsOf(device: string): readonly EventInfo[] {
    const old = this.#known.get(device)?.id;
    return this.#events.filter((event) => event.device === old).map((event) => ({ ...event, device }));
  }

  /** When something of the device came last, unix s; NaN when nothing ever did. To be asked before its rings are handed over. */
  lastOf(device: string): number {
    const old = this.#known.get(device)?.id;
    return this.#held.reduce((last, { info, ring }) => (info.device === old && !(ring.newest <= last) && ring.newest === ring.newest ? ring.newest : last), NaN);
  }

  /** Give back the memory of what nobody came for. */
  release(): void {
    for (const { ring } of this.#held.splice(0)) ring.release();
  }
}
