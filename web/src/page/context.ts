/** State of a page that its parts share: what a panel is given, and what components are given besides. */
import type { Signal } from "@preact/signals";
import type { FunctionComponent } from "preact";
import type { Channel } from "../data/channels";
import type { Stats } from "../data/statistics";
import type { Store } from "../data/store";
import type { TimeBase } from "../data/view";
import type { ViewState } from "../data/view-state";
import type { ExtensionOverlay } from "../extension/extension";
import type { Begin } from "../forms/add-device";
import type { SampleAccess } from "../measure/sample-access";
import type { CursorReading } from "../data/cursor-time";
import type { RecentHealth } from "../data/health-history";
import type { HttpProblem, Port } from "../requests/http";
import type { PageState } from "./page-state";
import type { DeviceInfo, EventInfo } from "../wire/types";

declare module "../extension/extension" {
  interface Extension {
    readonly dialogs?: readonly ExtensionDialog[];
    /** Called once for each page of a document. */
    readonly start?: (app: App) => void;
  }
}

/** Filter of the list. */
export type Sort = "all" | "loss" | "device" | "commands" | "markers" | "alarms";

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
  /** The recording that the samples belong to; undefined on Live. */
  readonly recording?: {
    readonly id: string;
    /** Speed of playback, recorded seconds per second; 0 while paused. */
    readonly rate: () => number;
  };
  /** Samples of a recording missing after the reading position. */
  readonly lostLater?: (device: string) => number;
}

export type Overlay = "help" | "guide" | "palette" | "add" | "memory" | "packet" | ExtensionOverlay | undefined;

/** A panel over the plots while the window is narrow. */
export type Drawer = "rail" | "side" | undefined;

export interface App extends Deps {
  readonly device: { readonly value: DeviceInfo | undefined };
  readonly state: { readonly value: PageState };
  readonly overlay: Signal<Overlay>;
  /** What the dialog of an extension is about, if it was opened with that. */
  readonly subject: Signal<object | undefined>;
  /** The device whose decoding is being changed. */
  readonly keyFor: Signal<Begin | undefined>;
  /** The table being shown: name and title of its channel. */
  readonly openTable: Signal<{ readonly name: string; readonly title: string } | undefined>;
  /** The frame that is shown. */
  readonly packetAt: Signal<PacketAt | undefined>;
  /** The address typed for a new device; it stays while its dialog is closed. */
  readonly newAddress: Signal<string>;
  readonly sheet: Signal<Drawer>;
  /** Whether the tree of all signals is open beside the plots. */
  readonly showsSignals: Signal<boolean>;
  /** Whether the side panel is folded on a wide window. */
  readonly folded: Signal<boolean>;
  /** The last request that failed; stays until dismissed. */
  readonly problem: Signal<HttpProblem | undefined>;
  /** Why the server refuses access, once known. */
  readonly refusal: Signal<HttpProblem | undefined>;
  readonly ports: Signal<readonly Port[]>;
  readonly scanning: Signal<boolean>;
  /** Counts half seconds, for components that show an age or a countdown. */
  readonly tick: Signal<number>;
  /** The device that a link named: its key or its id. */
  readonly linked: Signal<string | undefined>;
  /** A requested device, by id; a newly added one is selected as soon as the server reports it. */
  readonly awaited: Signal<string | undefined>;
  /** Ends what it does by itself. */
  readonly stop: () => void;
}

export interface DeviceActionProps {
  readonly app: App;
  readonly device: DeviceInfo;
}

export interface LiveDialogProps extends DeviceActionProps {
  readonly onClose: () => void;
}

/** A dialog over Live, over a recording or both, opened by `app.overlay.value = "NAME/…"`. */
export interface ExtensionDialog {
  readonly overlay: ExtensionOverlay;
  readonly Live?: FunctionComponent<LiveDialogProps>;
}
