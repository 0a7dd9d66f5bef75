/** What the page is looking at: device, time window, cursor. Shared by plots, panels and keys; small, reactive, no samples. */
import { signal } from "@preact/signals";

/** Which clock the x axis shows. */
export type TimeBase = "device" | "arrival";

export interface View {
  /** DeviceInfo.id of the selected device, or undefined before the first one. */
  readonly device: string | undefined;
  /** True: the right edge is now. False: it stays at `end`. */
  readonly live: boolean;
  /** Right edge of the window, unix seconds (server clock); read only when not live. */
  readonly end: number;
  /** Length of the window in seconds. */
  readonly span: number;
  readonly timeBase: TimeBase;
}

export const view = signal<View>({ device: undefined, live: true, end: 0, span: 20, timeBase: "device" });

/**
 * Where the reading cursor is: under the pointer as a fraction of the plot's width (its time runs while live), or pinned to
 * a time by a click (it moves left with the data); undefined: panels read the newest sample.
 */
export type Cursor = { readonly kind: "pointer"; readonly fraction: number } | { readonly kind: "pinned"; readonly time: number } | undefined;

export const cursor = signal<Cursor>(undefined);

/** The second cursor, for measuring: unix seconds. */
export const measure = signal<number | undefined>(undefined);

/** Series hidden by the user, as `${channelName}.${columnName}`. */
export const hidden = signal<ReadonlySet<string>>(new Set());

/** Norms that were seen, by the same keys: each is hidden once, when first seen, because it is read in the legend and drawn when asked for. */
export const normsSeen = new Set<string>();

/** Frame in which attitude is shown; undefined: as the device sends it. */
export const frame = signal<"ENU" | "NED" | "NWU" | undefined>(undefined);
