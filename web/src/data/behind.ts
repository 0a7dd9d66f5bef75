/**
 * "Behind by": time from the arrival of a device's bytes to what the page shows of them, by where it arises.
 *
 *     device ══ link ══> server ── decoding ──> ── connection ──> worker ── page ──> rings
 *               by the device's clock  └ both in DeviceHealth      └ both measured here, on each live frame
 *
 * The two clocks agree within some ms.
 */
import type { BusyReason, DeviceHealth } from "../wire/types";

export type Part = "link" | "decoding" | "connection" | "page";
export const PARTS: readonly Part[] = ["link", "decoding", "connection", "page"];

export interface BehindBy {
  /** In all, s; 0 while it is too short to be told. */
  readonly total: number;
  readonly parts: Readonly<Record<Part, number>>;
  /** Where most of it arises. */
  readonly part: Part;
  readonly reason: BusyReason;
}

/** A shorter time is not told: a person hardly sees it, and packets of networks come later. */
export const TOLD_S = 0.5;
/** Measurements count as current for this long, s: a device may send once a second. */
const FRESH_S = 2;

interface Delay {
  readonly at: number;
  readonly connection: number;
  readonly page: number;
}

/** Delays of the newest live frames of each device. Times in unix s by the server's clock. */
export class PageDelays {
  readonly #of = new Map<string, Delay>();

  /** A frame of a device, sent at `sent`, received by the worker at `received` and put into its ring now. */
  note(device: string, sent: number, received: number, now: number): void {
    if (!Number.isFinite(received)) return; // the server's clock is not known yet
    this.#of.set(device, { at: now, connection: Math.max(0, received - sent), page: Math.max(0, now - received) });
  }

  /** By how much a device is behind at `now`. */
  behind(device: string, health: Pick<DeviceHealth, "behind"> | undefined, now: number): BehindBy {
    const delay = this.#of.get(device);
    const known = delay !== undefined && now - delay.at < FRESH_S ? delay : undefined;
    const { link = 0, decoding = 0, reason = "" } = health?.behind ?? {};
    const parts = { link, decoding, connection: known?.connection ?? 0, page: known?.page ?? 0 };
    const total = PARTS.reduce((sum, part) => sum + parts[part], 0);
    const part = PARTS.reduce((most, one) => (parts[one] > parts[most] ? one : most));
    return { total: total > TOLD_S ? total : 0, parts, part, reason };
  }

  clear(): void {
    this.#of.clear();
  }
}
