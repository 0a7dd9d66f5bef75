/**
 * Door for extensions of the page: what it has beyond its heart, each in a folder of its own.
 *
 *     extensions/NAME/index.ts(x)   registerExtension({ name: "NAME", … })
 *
 * extensions/all.ts finds the folders; nothing else names them, and a folder that is removed leaves a page without it. What is seldom
 * shown is fetched when it is first shown (ui/late.tsx). Texts are in texts.ts of the folder, and its style sheets are in the layer
 * `extensions.NAME`. A view stands in a slot, in the order of its number.
 */
import type { FunctionComponent } from "preact";
import type { Channel } from "./data/channels";
import type { Forms } from "./forms/types";
import type { App } from "./pages/app-state";
import type { ComparisonActionProps } from "./pages/configure/compare";
import type { Model } from "./pages/configure/model";
import type { PageEntry, Route } from "./pages/route";
import type { OpenRecording } from "./pages/recordings/open-recording";
import type { RecordingInfo } from "./recordings/types";
import type { Deps } from "./panels/panel-context";
import { type PanelDefinition, registerPanel } from "./panels/registry";
import type { PlotMarks, SeriesAction } from "./plots/plot-additions";
import type { UnderPlots } from "./plots/under-plots";
import type { TreeRow } from "./signals/tree-rows";
import type { Panel } from "./ui/dom";
import type { Viewer } from "./views/viewer";
import { capabilities } from "./wire/capabilities";
import type { DeviceInfo } from "./wire/types";
import type { Companion, CompanionProps } from "./workspace/companions";
import type { WorkspaceSession } from "./workspace/session";

export interface DeviceActionProps {
  readonly app: App;
  readonly device: DeviceInfo;
}

export interface RecordingProps {
  readonly app: App;
  readonly info: RecordingInfo;
}

interface SignalsProps {
  readonly deps: Deps;
  readonly isLive: boolean;
  /** Takes the last action, in words. */
  readonly onSaid: (words: string) => void;
}

/** Places for views of extensions, with the properties that a view gets there. */
export interface Slots {
  /** Bands over every page. */
  readonly bands: { readonly app: App };
  /** Buttons of the top bar over plots: those of Live, or of an open recording. */
  readonly barViews: { readonly app: App; readonly isLive: boolean };
  /** Buttons of the top bar over the plots of Live, before "Share". */
  readonly barShare: { readonly app: App };
  /** Actions of the selected device in the list of devices. */
  readonly deviceActions: DeviceActionProps;
  /** In the row of a device in that list, under its facts. */
  readonly deviceRow: DeviceActionProps;
  /** Actions of the row that is chosen in the tree of signals. */
  readonly signalActions: SignalsProps & { readonly row: TreeRow };
  /** Actions over the tree of signals. */
  readonly signalsHead: SignalsProps;
  /** Under the plots of Live or of an open recording. */
  readonly underPlots: UnderPlots;
  /** Over the lists of panels, while they are arranged. */
  readonly workspaceSheet: Pick<CompanionProps, "session" | "deps">;
  /** Under the stored workspaces: what the last one brought besides the view. */
  readonly workspaceCompanions: CompanionProps;
  /** On the right of Configure; without a model there is no device. */
  readonly configureSide: { readonly app: App; readonly model: Model | undefined };
  /** Under the comparison of two states of a device, in Configure. */
  readonly comparisonActions: ComparisonActionProps;
  /** In the row of a recording in the library, before its facts. */
  readonly recordingRow: RecordingProps;
  /** Under the facts of a recording that is selected in the library. */
  readonly recordingDetails: RecordingProps;
  /** Actions of an open recording, beside its name. */
  readonly recordingActions: { readonly recording: OpenRecording };
  /** On a phone, the line over an open recording that opens other views of it. */
  readonly recordingViews: { readonly recording: OpenRecording };
  /** What can be made of the bytes in memory besides a recording. */
  readonly memoryActions: { readonly app: App; readonly disabled: boolean };
  /** Over everything else of an open recording. */
  readonly recordingOverlays: { readonly recording: OpenRecording };
}

type SlotView = {
  readonly [Name in keyof Slots]: {
    readonly slot: Name;
    readonly order: number;
    readonly View: FunctionComponent<Slots[Name]>;
  };
}[keyof Slots];

export interface LiveDialogProps extends DeviceActionProps {
  readonly onClose: () => void;
}

export interface RecordingDialogProps {
  readonly recording: OpenRecording;
  readonly onClose: () => void;
}

/** A dialog over Live, over a recording or both, opened by `app.overlay.value = "NAME/…"`. */
export interface ExtensionDialog {
  readonly overlay: ExtensionOverlay;
  readonly Live?: FunctionComponent<LiveDialogProps>;
  readonly Recording?: FunctionComponent<RecordingDialogProps>;
}

/** A page, "#/NAME?…" in the address. */
export interface ExtensionPage extends PageEntry {
  /**
   * It shows other hosts, and a server that offers it has no device of its own: it then takes the place of Live and Configure. Nothing is
   * recorded from it.
   */
  readonly isRemote?: boolean;
  /** Whether the navigation leads to it. Reads signals. */
  readonly isOffered: (app: App) => boolean;
  readonly View: FunctionComponent<{ readonly app: App }>;
}

export interface ExtensionPress {
  readonly app: App;
  /** The one it was pressed over; undefined on Live. */
  readonly recording?: OpenRecording;
  readonly isShifted: boolean;
}

/** A page at certain addresses of another one. */
export interface ExtensionAddress {
  readonly takes: (route: Route) => boolean;
  readonly View: FunctionComponent<{ readonly app: App }>;
}

/** A place among the settings of a device, "#/configure/DEVICE/NAME" in the address. */
export interface ConfigurePlace {
  readonly name: string;
  readonly title: string;
  /** A word beside the title in the list. */
  readonly note: string;
  /** Whether the list leads to it. */
  readonly applies: (forms: Forms) => boolean;
  readonly View: FunctionComponent<{ readonly model: Model }>;
}

export interface AttitudeCell {
  /** Whether it has something to show of a device with these channels. */
  readonly applies: (channels: readonly Channel[]) => boolean;
  readonly mount: (host: HTMLElement, deps: Deps) => Panel;
}

/** Shows what it has for a family, as long as nothing was changed meanwhile. */
export type WorkspaceDefault = (session: WorkspaceSession, family: string, isUntouched: () => boolean) => Promise<void>;

/** A key of Live and of open recordings. */
export interface ExtensionKey {
  /** A letter, in lower case. */
  readonly key: string;
  /** Its line in the list of keys: under this title, before the line of a key or at the end. */
  readonly group: string;
  readonly before?: string;
  readonly what: string;
  /** Whether the line has it with Shift too. */
  readonly withShift?: boolean;
  readonly press: (at: ExtensionPress) => void;
}

/** Name of a dialog: that of its extension comes first. */
export type ExtensionOverlay = `${string}/${string}`;

export interface Extension {
  /** Unique: the name of its folder. */
  readonly name: string;
  /** Called once for each page of a document. */
  readonly start?: (app: App) => void;
  readonly pages?: readonly ExtensionPage[];
  readonly addresses?: readonly ExtensionAddress[];
  readonly configurePlaces?: readonly ConfigurePlace[];
  readonly panels?: readonly PanelDefinition[];
  readonly views?: readonly SlotView[];
  readonly dialogs?: readonly ExtensionDialog[];
  readonly keys?: readonly ExtensionKey[];
  /** Viewers that show devices or recordings in a frame. */
  readonly viewers?: readonly Viewer[];
  /** Cells beside the attitude. */
  readonly attitudeCells?: readonly AttitudeCell[];
  /** What is drawn over the plots. */
  readonly plotMarks?: readonly PlotMarks[];
  /** What the menu of a series in the legend of a plot opens: that of the first that has one. */
  readonly seriesActions?: readonly SeriesAction[];
  /** What a page opens with for a family, if neither its address nor this browser says anything. */
  readonly workspaceDefaults?: readonly WorkspaceDefault[];
  /** What travels with a workspace. */
  readonly companions?: readonly Companion[];
}

const extensions = new Map<string, Extension>();

/**
 * Makes an extension part of the page.
 *
 * @throws Error if its name is taken, or a dialog is not named after it
 */
export function registerExtension(extension: Extension): void {
  const { name, panels = [], dialogs = [] } = extension;
  if (extensions.has(name)) throw new Error(`two extensions have the name ${name}`);
  const foreign = dialogs.find(({ overlay }) => !overlay.startsWith(`${name}/`));
  if (foreign) throw new Error(`the dialog ${foreign.overlay} of ${name} must begin with "${name}/"`);
  extensions.set(name, extension);
  for (const panel of panels)
    registerPanel({ ...panel, applies: (deps) => isThere(extension) && (panel.applies?.(deps) ?? true) });
}

type Kinds = Exclude<keyof Extension, "name" | "panels" | "start">;

/** What all extensions bring of one kind. */
export function fromExtensions<Kind extends Kinds>(kind: Kind): readonly NonNullable<Extension[Kind]>[number][] {
  return [...extensions.values()].filter(isThere).flatMap((extension) => [...(extension[kind] ?? [])]);
}

/** Whether the server has its part of an extension: a smaller installation leaves some out, and an older server does not say so. */
const isThere = ({ name }: Extension): boolean => !(capabilities.value.absent ?? []).some((one) => one.name === name);

export function startExtensions(app: App): void {
  for (const { start } of extensions.values()) start?.(app);
}

/** Classes of buttons in the top bar: what they do to a bar that is full (ui/layout.css, ui/phone.css). */
export const BAR_CLASS = {
  /** Takes the place of the name of the page on a phone. */
  overPlots: "over-plots",
  /** The first to be left out. */
  spareFirst: "spare-first",
  /** Left out while something is recorded, and on a phone. */
  spare: "desk spare",
} as const;

interface SlotProps<Name extends keyof Slots> {
  readonly name: Name;
  readonly with: Slots[Name];
}

/** The views of a slot, in their order. */
export function Slot<Name extends keyof Slots>({ name, with: properties }: SlotProps<Name>) {
  const views = fromExtensions("views").filter(({ slot }) => slot === name);
  const inOrder = views.toSorted((a, b) => a.order - b.order);
  return (
    <>
      {inOrder.map(({ View }, index) => {
        const Shown = View as FunctionComponent<Slots[Name]>; // of this slot
        return <Shown key={index} {...properties} />;
      })}
    </>
  );
}
