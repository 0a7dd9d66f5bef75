/** The workspace of a page while it is shown: its keys and its steps of undo. */
import type { RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";
import type { ViewState } from "../data/view-state";
import type { App } from "../page/context";
import type { WorkspaceView } from "./parts";
import { followWorkspace, sessionOf, type WorkspaceSession } from "./session";
import { belongsToControl } from "../page/keys";
import { maximise } from "../data/layout";
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

/** Before the keys of the page: Esc first gives a maximised panel its place back. */
function listenForWorkspaceKeys(session: WorkspaceSession, root: () => HTMLElement | null): () => void {
  const onKey = (event: KeyboardEvent): void => {
    if (event.defaultPrevented || document.querySelector("dialog[open]") !== null) return;
    const target = event.target instanceof HTMLElement ? event.target : document.body;
    const within = target.closest(".app");
    if (within !== null && within !== root()) return;
    const type = target instanceof HTMLInputElement ? target.type : "";
    if (belongsToControl(target.tagName, type, target.isContentEditable, event) && event.key !== "Escape") return;
    if (act(session, event, root())) event.preventDefault();
  };
  addEventListener("keydown", onKey, true);
  return () => removeEventListener("keydown", onKey, true);
}

/** False for keys that are not its own. */
function act(session: WorkspaceSession, event: KeyboardEvent, root: HTMLElement | null): boolean {
  const key = event.key.toLowerCase();
  const { arranging } = session;
  if (event.altKey) return false;
  if (event.ctrlKey || event.metaKey) {
    if (key === "z") event.shiftKey ? session.redo() : session.undo();
    else if (key === "y" && !event.shiftKey) session.redo();
    else return false;
    return true;
  }
  if (key === "w") arranging.value = !arranging.peek();
  else if (key === "x") {
    const id = session.view.viewState.layout.peek().maximised ?? panelAtHand(root);
    if (id === undefined) return false;
    session.toggleMaximised(id);
  } else if (key === "escape" && session.view.viewState.layout.peek().maximised !== undefined)
    session.change((layout) => maximise(layout, undefined));
  else if (key === "escape" && arranging.peek()) arranging.value = false;
  else return false;
  return true;
}

/** A double click on the heading of a panel, or on the attitude, gives it the whole page, or its place back. */
function listenForDoubleClicks(session: WorkspaceSession, root: HTMLElement | null): () => void {
  const onDblClick = ({ target }: MouseEvent): void => {
    if (!(target instanceof Element) || target.closest("button, a, input, select")) return;
    const id = target.closest(".head, .attitude")?.closest<HTMLElement>("[data-panel]")?.dataset["panel"];
    if (id === undefined) return;
    getSelection()?.removeAllRanges(); // the words under the pointer
    session.toggleMaximised(id);
  };
  root?.addEventListener("dblclick", onDblClick);
  return () => root?.removeEventListener("dblclick", onDblClick);
}

/** The panel with the focus, or the one under the pointer. */
function panelAtHand(root: HTMLElement | null): string | undefined {
  const focused = document.activeElement?.closest<HTMLElement>("[data-panel]");
  const hovered = root?.querySelector<HTMLElement>("[data-panel]:hover");
  return (focused ?? hovered)?.dataset["panel"];
}
