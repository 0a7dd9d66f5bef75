/** Checks of a part of a workspace that an extension registers. */
import { signal } from "@preact/signals";
import { expect } from "vitest";
import { createViewState } from "../data/view-state";
import { applyWorkspace, FORMAT, VERSION, type WorkspaceView, workspaceOf } from "../workspace/parts";
import type { Json } from "../data/json";

const fresh = (): WorkspaceView => ({ viewState: createViewState(), folded: signal(false) });
const workspace = (parts: object): unknown => ({ format: FORMAT, version: VERSION, parts });

/** The part is restored equal from each of these states, on a fresh view and one after the other. */
export function expectRestored(key: string, states: readonly Json[]): void {
  const used = fresh();
  for (const state of states)
    for (const view of [fresh(), used]) {
      expect(applyWorkspace(view, workspace({ [key]: state }))).toEqual([]);
      expect(workspaceOf(view).parts[key]).toEqual(state);
    }
  expect(applyWorkspace(used, workspace({}))).toEqual([]);
  expect(workspaceOf(used).parts[key]).toBeUndefined();
}

/** Each of these changes nothing, and is told. */
export function expectRefused(key: string, states: readonly Json[]): void {
  for (const state of states) {
    const view = fresh();
    const before = workspaceOf(view);
    expect(applyWorkspace(view, workspace({ [key]: state }))).toHaveLength(1);
    expect(workspaceOf(view)).toEqual(before);
  }
}
