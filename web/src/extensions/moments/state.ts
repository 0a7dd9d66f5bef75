/** State of the bar of a view: it outlives the page of a recording, which is rebuilt when more of it has been decoded. */
import { signal } from "@preact/signals";
import type { ViewState } from "../../data/view-state";
import { madeFor } from "../../page/app-state";
import type { HttpProblem } from "../../requests/http";

/** What "next" and "previous" go to. */
export type Destination = "sample" | "event" | "marker" | "gap" | "condition";

/** The bar that goes to a moment (go-to.tsx). */
export interface GoToBar {
  readonly isOpen: boolean;
  /** As typed: a time or a condition. */
  readonly text: string;
  readonly kind: Destination;
  /** The answer to the last move. */
  readonly said?: { readonly words: string } | { readonly problem: HttpProblem } | undefined;
}

export const stateOf = madeFor((_view: ViewState) => ({
  bar: signal<GoToBar>({ isOpen: false, text: "", kind: "event" }),
  /** Go to the next or previous place of the chosen kind. */
  steps: { go: (_forward: boolean): void => undefined },
}));

export function openGoTo(view: ViewState): void {
  const { bar } = stateOf(view);
  bar.value = { ...bar.peek(), isOpen: true };
}

export const stepPlace = (view: ViewState, forward: boolean): void => stateOf(view).steps.go(forward);
