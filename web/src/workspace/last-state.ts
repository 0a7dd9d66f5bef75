/**
 * What a page opens with, if its address says nothing: the last state of this browser for the family of the device, or else what
 * an extension has for the family.
 */
import { effect } from "@preact/signals";
import { fromExtensions } from "../extension/extension";
import type { App } from "../page/context";
import { withoutMoment, workspaceOf } from "./parts";
import { sessionOf, type WorkspaceSession } from "./session";

/** Shows the last state of a family, unless something has been changed since. */
export type WorkspaceDefault = (session: WorkspaceSession, family: string, isUntouched: () => boolean) => Promise<void>;

declare module "../extension/extension" {
  interface Extension {
    /** What a page opens with for a family, if neither its address nor this browser says anything. */
    readonly workspaceDefaults?: readonly WorkspaceDefault[];
  }
}

const KEY = "imuscope.workspace.";
/** Interval at which the state is stored, ms. */
const STORE_MS = 1000;

/** The storage may be forbidden or full: the page then opens with the default. */
function stored(family: string): unknown {
  try {
    return JSON.parse(localStorage.getItem(KEY + family) ?? "null");
  } catch {
    return null;
  }
}

function store(family: string, text: string): void {
  try {
    localStorage.setItem(KEY + family, text);
  } catch {
    // as above
  }
}

/** Restore the state of Live, and store it from then on. @param isLinked the address says what to show */
export function startLastState(app: App, isLinked: boolean): () => void {
  const session = sessionOf(app, app.viewState);
  const textNow = (): string => JSON.stringify(workspaceOf(session.view, withoutMoment));
  let family: string | undefined;
  let text = "";
  let isReady = false;
  const begin = async (first: string): Promise<void> => {
    const before = textNow();
    const last = stored(first);
    if (!isLinked && last !== null) session.open(last);
    else if (!isLinked) {
      // Changes that the user has made since are kept.
      for (const open of fromExtensions("workspaceDefaults")) await open(session, first, () => textNow() === before);
    }
    session.history.restart();
    text = textNow();
    isReady = true;
  };
  const stop = effect(() => {
    const protocol = app.device.value?.protocol;
    if (protocol === undefined || protocol === "") return;
    const isFirst = family === undefined;
    family = protocol;
    if (isFirst) void begin(protocol);
  });
  const keep = (): void => {
    if (!isReady || family === undefined) return;
    const now = textNow();
    if (now === text) return;
    text = now;
    store(family, now);
  };
  const timer = setInterval(keep, STORE_MS);
  addEventListener("pagehide", keep);
  return () => {
    stop();
    clearInterval(timer);
    removeEventListener("pagehide", keep);
  };
}
