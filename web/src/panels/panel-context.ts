/** Context passed to a panel when it is mounted. */
import type { Deps } from "../page/context";
import type { Channel } from "../data/channels";
import type { ChannelInfo, DeviceInfo } from "../wire/types";
import { type Recent, recentOf } from "./health-text";
import { type CursorReading, readingAt } from "../data/cursor-time";
import { clock } from "../ui/format/format";
import { TEXT } from "../texts/panels";

/** The moment read by the panels. */
export function reading(deps: Deps): CursorReading {
  const { view, cursor, device, measure } = deps.viewState;
  return readingAt(view.value, cursor.value, deps.store.edgeOf(device.value), measure.value);
}

/** "now", "at A 14:23:51.000, off screen". */
export function momentWords(at: CursorReading): string {
  if (at.word === "now") return TEXT.reading.now;
  return TEXT.atTime([at.mark, clock(at.time, 3)].filter(Boolean).join(" "), at.isOffScreen ? TEXT.offScreen : "");
}

export function channelsOf(deps: Deps): readonly Channel[] {
  const device = deps.viewState.device.value;
  return deps.store.channels.value.filter((channel) => channel.info.device === device);
}

export function selected(deps: Pick<Deps, "store" | "viewState">): DeviceInfo | undefined {
  const id = deps.viewState.device.value;
  return deps.store.devices.value.find((device) => device.id === id);
}

/** Descriptions of the channels of the selected device. */
export function channelInfos(deps: Deps): readonly ChannelInfo[] {
  return channelsOf(deps).map(({ info }) => info);
}

/** Problems of a device within its last minute: the one before now, or before the end of a file. */
export function recently(deps: Pick<Deps, "store">, device: string): Recent {
  return recentOf(deps.store.events.value, device, deps.store.edgeOf(device));
}

/** Samples whose steps are looked at. */
const STEPS = 8;

/** Usual time between arrivals of the fastest channel of a device, s; Infinity while too few have arrived. */
export function usualStep(deps: Pick<Deps, "store">, device: string): number {
  let least = Infinity;
  for (const { info, ring } of deps.store.channels.value) {
    const n = Math.min(ring.length, STEPS);
    if (info.device !== device || n < 3) continue;
    least = Math.min(least, (ring.arrival(ring.length - 1) - ring.arrival(ring.length - n)) / (n - 1));
  }
  return least;
}

/** Messages sent in turns start in turns: up to this long before its first sample a quantity reads that one, s. Recordings open there. */
const EARLY_S = 0.5;

/** Index of the sample that `at` reads in a channel; -1 when there is none. */
export function sampleAt(channel: Channel, at: CursorReading): number {
  const { ring } = channel;
  if (at.time === Number.POSITIVE_INFINITY) return ring.length - 1;
  const i = ring.indexAt(at.time, at.base);
  return i < 0 && ring.length > 0 && ring.time(0) - at.time < EARLY_S ? 0 : i;
}

/** Seconds since anything arrived from the device; undefined before the first byte. */
export function ageOf(deps: Deps, device: string): number | undefined {
  let newest: number | undefined;
  const now = deps.store.serverNow();
  for (const { info, ring } of deps.store.channels.value) {
    if (info.device !== device || ring.length === 0) continue;
    // a recording also has samples after the reading position
    const at = ring.arrival(ring.length - 1) > now ? ring.indexAt(now, "arrival") : ring.length - 1;
    if (at < 0) continue;
    const arrival = ring.arrival(at);
    if (newest === undefined || arrival > newest) newest = arrival;
  }
  newest ??= deps.store.health.value.get(device)?.last_arrival ?? undefined;
  return newest === undefined ? undefined : Math.max(0, now - newest);
}
