/**
 * The panels of the page: each file of this folder that has one registers it as it is loaded, and the page shows those that
 * apply, in their order. docs/add-a-panel.md explains how to write one.
 */
import { fromExtensions } from "../extension/extension";
import { signal } from "@preact/signals";
import type { ComponentChildren, FunctionComponent } from "preact";
import type { Panel } from "../ui/dom/dom";
import { protocolAmong } from "../wire/capabilities";
import type { Deps } from "../page/context";

declare module "../extension/extension" {
  interface Extension {
    readonly panels?: readonly PanelDefinition[];
  }
}

/** Place of a panel at first: the strip over the plots of a phone, the middle, the side column, or its scrolling part. */
export type PanelPlace = "strip" | "main" | "side" | "below";

export interface PanelDefinition {
  /** Unique. */
  readonly id: string;
  readonly title: string;
  /** A word beside the title. */
  readonly note?: ComponentChildren;
  readonly where: PanelPlace;
  /** Panels of one place are in ascending order. */
  readonly order: number;
  /** Not shown until a person asks for it. */
  readonly optional?: boolean;
  /** It needs the width of the middle and cannot be moved to the side column. */
  readonly isWide?: boolean;
  /** How high it is in the middle until a person changes that. */
  readonly height?: "high" | "higher";
  /** Class of the element that the panel is mounted into. */
  readonly class?: string;
  /** False if there is nothing to show; called again when a signal that it reads has changed. Default: always. */
  readonly applies?: (deps: Deps) => boolean;
  /** It reads at the cursor, and has no words of its own for that: its heading says so while the cursor is off screen. */
  readonly readsCursor?: boolean;
  /** Mount the panel into `host`; `caption` is beside the title, for changing text. */
  readonly mount: (host: HTMLElement, deps: Deps, caption: HTMLElement | null) => Panel;
  /** Components under it. */
  readonly after?: FunctionComponent<{ readonly deps: Deps }>;
}

const panels = new Map<string, PanelDefinition>();
/** How many there are: those of extension packages are added while the page is shown. */
const added = signal(0);

export function registerPanel(definition: PanelDefinition): void {
  if (panels.has(definition.id)) throw new Error(`two panels have the id ${definition.id}`);
  panels.set(definition.id, definition);
  added.value = panels.size;
}

export const allPanels = (): readonly PanelDefinition[] => [...panels.values(), ...fromExtensions("panels")];

/** The panels that a workspace arranges, in their default order. Reads signals: call it while a component is rendered. */
export function arrangedPanels(deps: Deps): readonly PanelDefinition[] {
  return (["main", "side", "below"] as const).flatMap((where) => panelsAt(where, deps));
}

/**
 * The panels of a place that apply, in order: first those named by the device's protocol. Reads signals: call it while a component is
 * rendered.
 */
export function panelsAt(where: PanelPlace, deps: Deps): readonly PanelDefinition[] {
  const first = protocolAmong(deps.store.devices.value, deps.viewState.device.value)?.panels ?? [];
  const rank = ({ id }: PanelDefinition): number => (first.includes(id) ? first.indexOf(id) : first.length);
  void added.value;
  return allPanels()
    .filter((panel) => panel.where === where && (panel.applies?.(deps) ?? true))
    .sort((a, b) => rank(a) - rank(b) || a.order - b.order);
}
