/** Keys of an open recording: those of Live, with playback instead of live mode. */
import type { ReplayController } from "../../recordings/replay-controller";
import { actionFor, belongsToControl, type KeyAction, nextSpan } from "../../ui/keys";
import { overlay, sheet } from "../app-state";
import { exporting } from "./export-dialog";
import { beginMarker } from "./markers";
import { copyLink } from "./share-menu";

export function listenForKeys(replay: ReplayController): () => void {
  let chord = -Infinity;
  const onKey = (event: KeyboardEvent): void => {
    if (event.defaultPrevented || overlay.peek() !== undefined || exporting.peek() !== undefined) return;
    const target = event.target instanceof HTMLElement ? event.target : document.body;
    const type = target instanceof HTMLInputElement ? target.type : "";
    if (belongsToControl(target.tagName, type, target.isContentEditable, event)) return;
    const key = event.key.toLowerCase();
    const waits = event.timeStamp - chord < 1500; // "G, then a letter" goes to another page
    chord = key === "g" ? event.timeStamp : -Infinity;
    if (waits || event.ctrlKey || event.metaKey || event.altKey) return;
    if (key === "l") replay.toggleLoop();
    else {
      const action = actionFor(event);
      if (!action || !act(replay, action)) return;
    }
    event.preventDefault();
  };
  addEventListener("keydown", onKey);
  return () => removeEventListener("keydown", onKey);
}

/** False for actions not handled here. */
function act(replay: ReplayController, action: KeyAction): boolean {
  const { view, cursor, measure, actions } = replay.viewState;
  switch (action.do) {
    case "playPause":
      replay.toggle();
      return true;
    case "start":
      replay.seek(replay.bounds.first);
      return true;
    case "now":
      replay.seek(replay.bounds.last);
      return true;
    case "mark":
    case "note":
      beginMarker(replay);
      return true;
    case "pan":
      actions.pan(action.windows);
      return true;
    case "step":
      replay.playing.value = false;
      actions.stepSample(action.samples);
      return true;
    case "span":
      actions.setSpan(nextSpan(view.peek().span, action.longer));
      return true;
    case "zoom":
      zoomAtHead(replay, action.factor);
      return true;
    case "fit":
      actions.fit();
      return true;
    case "timeBase":
      actions.toggleTimeBase();
      return true;
    case "series":
      actions.toggleSeries(action.index, action.alone);
      return true;
    case "link":
      void copyLink(replay);
      return true;
    case "close":
      if (sheet.peek()) sheet.value = undefined;
      else if (measure.peek() !== undefined) measure.value = undefined;
      else if (cursor.peek()?.kind !== "pinned") return false;
      return true;
    case "record":
    case "askRecord":
    case "help":
      return false;
  }
}

/** Zoom about the reading position if it is on screen; else about the middle. */
export function zoomAtHead(replay: ReplayController, factor: number): void {
  const { view, actions } = replay.viewState;
  const { end, span } = view.peek();
  const place = (replay.head - (end - span)) / span;
  actions.zoom(factor, place >= 0 && place <= 1 ? place : 0.5);
}
