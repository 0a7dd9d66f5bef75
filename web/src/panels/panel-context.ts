/** What a panel is given when it is mounted. */
import { cursor, view } from "../data/view-state";
import type { Stats } from "../data/statistics";
import type { Channel } from "../data/channels";
import type { Store } from "../data/store";
import type { DeviceInfo, EventInfo } from "../wire/types";
import { type Recent, recentOf } from "./health-text";
import type { Minute } from "./health-history";
import { type Reading, readingAt } from "./cursor-time";

export interface Deps {
  readonly store: Store;
  readonly minute: Minute;
  /** What a column's window amounts to, when the store holds only some of its samples; undefined while that is not known. */
  readonly statistics?: (channel: Channel, column: number, at: Reading) => Stats | undefined;
  /** All that happened, where the store tells of what had happened by then. */
  readonly allEvents?: readonly EventInfo[];
  /** Shows a moment, where that is more than to look at it. */
  readonly jump?: (to: { readonly t0: number; readonly t1: number }) => void;
  /** Samples of a recording that are missing after where it is read. */
  readonly lostLater?: (device: string) => number;
}

/** The moment that panels read now. */
export function reading(deps: Deps): Reading {
  return readingAt(view.value, cursor.value, deps.store.edgeOf(view.value.device));
}

/** Channels of the selected device. */
export function channelsOf(deps: Deps): readonly Channel[] {
  const device = view.value.device;
  return deps.store.channels.value.filter((channel) => channel.info.device === device);
}

export function selected(deps: Deps): DeviceInfo | undefined {
  const id = view.value.device;
  return deps.store.devices.value.find((device) => device.id === id);
}

/** What went wrong with a device within the last minute. */
export function recently(deps: Deps, device: string): Recent {
  return recentOf(deps.store.events.value, device, deps.store.serverNow());
}

/** What comes in turns begins in turns: before its first sample a quantity is read by that for so long, s. A recording opens there. */
const EARLY_S = 0.5;

/** Index of the sample that `at` reads in a channel; -1 when there is none. */
export function sampleAt(channel: Channel, at: Reading): number {
  const { ring } = channel;
  if (at.time === Number.POSITIVE_INFINITY) return ring.length - 1;
  const i = ring.indexAt(at.time, view.value.timeBase);
  return i < 0 && ring.length > 0 && ring.time(0) - at.time < EARLY_S ? 0 : i;
}

/** Seconds since anything arrived from the device; undefined before the first byte. */
export function ageOf(deps: Deps, device: string): number | undefined {
  let newest: number | undefined;
  const now = deps.store.serverNow();
  for (const { info, ring } of deps.store.channels.value) {
    if (info.device !== device || ring.length === 0) continue;
    // Of a recording there are samples from after where it is read, too.
    const at = ring.arrival(ring.length - 1) > now ? ring.indexAt(now, "arrival") : ring.length - 1;
    if (at < 0) continue;
    const arrival = ring.arrival(at);
    if (newest === undefined || arrival > newest) newest = arrival;
  }
  newest ??= deps.store.health.value.get(device)?.last_arrival ?? undefined;
  return newest === undefined ? undefined : Math.max(0, now - newest);
}
