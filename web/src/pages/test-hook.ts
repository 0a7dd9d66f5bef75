/**
 * Access for the browser tests. It exists only in a browser driven by a program, as `navigator.webdriver` reports, not on a user's
 * page.
 */
import type { Store } from "../data/store";
import type { ViewState } from "../data/view-state";
import type { ReplayController } from "../recordings/replay-controller";

declare global {
  interface Window {
    /** The live store, and the view that is on screen. */
    imuscope?: Pick<ViewState, "view" | "cursor" | "measure" | "actions"> & { readonly store: Store };
    /** The recording that is open. */
    imuscopeReplay?: ReplayController | undefined;
    /** Whether the address says what the view on screen shows. */
    imuscopeAddress?: () => boolean;
  }
}

export function showLive(store: Store, viewState: ViewState): void {
  if (!navigator.webdriver) return;
  const shown = (): ViewState => window.imuscopeReplay?.viewState ?? viewState;
  window.imuscope = {
    store,
    get view() {
      return shown().view;
    },
    get cursor() {
      return shown().cursor;
    },
    get measure() {
      return shown().measure;
    },
    get actions() {
      return shown().actions;
    },
  };
}

export function showReplay(replay: ReplayController | undefined): void {
  if (navigator.webdriver) window.imuscopeReplay = replay;
}

export function showAddress(isCurrent: () => boolean): void {
  if (navigator.webdriver) window.imuscopeAddress = isCurrent;
}
