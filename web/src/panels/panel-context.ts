/** Context passed to a panel when it is mounted. */
import type { TimeBase, ViewState } from "../data/view-state";
import type { Stats } from "../data/statistics";
import type { Channel } from "../data/channels";
import type { Store } from "../data/store";
import type { Signal } from "@preact/signals";
import type { Sort } from "./event-groups";
import type { ChannelInfo, DeviceInfo, EventInfo } from "../wire/types";
import { type Recent, recentOf } from "./health-text";
import type { RecentHealth } from "./health-history";
import type { ExtensionOverlay } from "../extension";
import { type CursorReading, readingAt } from "./cursor-time";
import type { SampleAccess } from "../measure/sample-access";

/** A sample as a plot shows it, and where it is in its frame. */
export interface ShownSample {
  /** "Rate of turn z" and "−45.58 °/s". */
  readonly name: string;
  readonly value: string;
  /** Names of the message and of the channel that was sent, and of the column; place of the column, −1 if it was computed. */
  readonly message: string;
  readonly channel: string;
  readonly column: string;
  readonly at: number;
}

export interface PacketAt {
  /** DeviceInfo.id */
  readonly device: string;
  /** Unix s, on the clock of `base`. */
  readonly time: number;
  readonly base: TimeBase;
  /** Channel of the sample; absent: any frame. */
  readonly channel?: number;
  /** The sample as its plot shows it. */
  readonly sample?: ShownSample;
  readonly kind?: "reject";
  /** Without a channel: place among the frames that arrived together. */
  readonly rank?: number;
  /** Name of the device; absent: as the store has it. */
  readonly name?: string;
  /** RecordingInfo.id; absent: a live device. */
  readonly recording?: string;
  /** Sets the cursor of its plots. */
  readonly pin: (time: number) => void;
}

/** Overlays that a panel can open. */
export interface Openers {
  /** The tree of all signals. */
  signals(): void;
  /** The rows of the table channel of that name. */
  rows(name: string, title: string): void;
  /** The frame at a time, byte by byte. */
  packet(at: PacketAt): void;
  /** A dialog of an extension, and what it is about. */
  dialog(name: ExtensionOverlay, about: object): void;
}

export interface Deps {
  readonly store: Store;
  readonly viewState: ViewState;
  readonly recentHealth: RecentHealth;
  readonly open: Openers;
  /** What the list of events holds. */
  readonly eventSort: Signal<Sort>;
  /** True while the newest value is old: headings then show its age. */
  readonly held: () => boolean;
  /** Statistics of a column over the window if the store holds only some of its samples; undefined until known. */
  readonly statistics?: (channel: Channel, column: number, at: CursorReading) => Stats | undefined;
  /** Samples of any range, if the store has only those around the cursor. */
  readonly samples?: SampleAccess;
  /** All events, if the store has only those up to the reading position. */
  readonly allEvents?: readonly EventInfo[];
  /** Shows a moment, if that needs more than a change of the view. */
  readonly jump?: (to: { readonly t0: number; readonly t1: number }) => void;
  /** The recording that the samples are of; undefined on Live. */
  readonly recording?: {
    readonly id: string;
    /** Speed of playback, recorded seconds per second; 0 while paused. */
    readonly rate: () => number;
  };
  /** Samples of a recording missing after the reading position. */
  readonly lostLater?: (device: string) => number;
}

/** The moment read by the panels. */
export function reading(deps: Deps): CursorReading {
  const { view, cursor, device } = deps.viewState;
  return readingAt(view.value, cursor.value, deps.store.edgeOf(device.value));
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
