/** The workspace of a page while it is shown: its keys and its steps of undo. */
import type { RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";
import type { ViewState } from "../data/view-state";
import type { App } from "../page/context";
import { listenForDoubleClicks, listenForWorkspaceKeys } from "./keys";
import type { WorkspaceView } from "./parts";
import { followWorkspace, sessionOf } from "./session";
import "./workspace.css";

/** @returns for the root of the page */
export function useWorkspace(
  app: App,
  viewState: ViewState,
  bounds?: WorkspaceView["bounds"],
): RefObject<HTMLDivElement | null> {
  const root = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const session = sessionOf(app, viewState, bounds);
    const stops = [
      listenForWorkspaceKeys(session, () => root.current),
      listenForDoubleClicks(session, root.current),
      followWorkspace(session),
    ];
    return () => stops.forEach((stop) => stop());
  }, [app, viewState, bounds]);
  return root;
}
