/**
 * What travels with a workspace besides the view: in its file, and with one stored by name. A server has it, whatever workspace is
 * shown, so it is no part (parts.ts): what an opened workspace brings is offered, not applied.
 *
 *     {"format": "imuscope-workspace", "version": 1, "parts": {…}, "KEY": …}
 */
import type { Signal } from "@preact/signals";
import type { Deps } from "../page/context";
import type { DeviceInfo } from "../wire/types";
import type { Json } from "../data/json";
import type { WorkspaceSession } from "./session";

declare module "../extension/extension" {
  interface Slots {
    /** Over the lists of panels, while they are arranged. */
    readonly workspaceSheet: Pick<CompanionProps, "session" | "deps">;
    /** Under the stored workspaces: what the last one brought besides the view. */
    readonly workspaceCompanions: CompanionProps;
  }
  interface Extension {
    /** What travels with a workspace. */
    readonly companions?: readonly Companion[];
  }
}

export interface Companion {
  /** Unique; its name in files, so it never changes. */
  readonly key: string;
  /** What is stored with a workspace of these devices; undefined: nothing. */
  readonly read: (devices: readonly DeviceInfo[]) => Promise<Json | undefined>;
  /** A sentence once it was saved in a file. */
  readonly saved: (json: Json) => string;
  /** Takes what an opened workspace brings; undefined: nothing. */
  readonly take: (session: WorkspaceSession, json: Json | undefined) => Promise<void>;
}

export interface CompanionProps {
  readonly session: WorkspaceSession;
  readonly deps: Deps;
  /** The last action, in words. */
  readonly said: Signal<string>;
}
