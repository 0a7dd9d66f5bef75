/** Keys of an open recording: those of Live, with playback instead of live mode. */
import type { ReplayController } from "../../recordings/replay-controller";
import { actionFor, belongsToControl, type KeyAction, nextSpan } from "../../page/keys";
import { exportingOf } from "../../recordings/exporting";
import { beginMarker } from "./markers";
import type { OpenRecording } from "./open-recording";
import { copyLink } from "./share-menu";

/** @param root of the recording: keys pressed in another one beside it are not its own */
export function listenForKeys(recording: OpenRecording, root: () => HTMLElement | null): () => void {
  const { replay, app } = recording;
  const exporting = exportingOf(app);
  let chord = -Infinity;
  const onKey = (event: KeyboardEvent): void => {
    if (event.defaultPrevented || app.overlay.peek() !== undefined || exporting.peek() !== undefined) return;
    const target = event.target instanceof HTMLElement ? event.target : document.body;
    const type = target instanceof HTMLInputElement ? target.type : "";
    const within = target.closest(".app");
    if (within !== null && within !== root()) return;
    if (belongsToControl(target.tagName, type, target.isContentEditable, event)) return;
    const key = event.key.toLowerCase();
    const waits = event.timeStamp - chord < 1500; // "G, then a letter" goes to another page
    chord = key === "g" ? event.timeStamp : -Infinity;
    if (waits || event.ctrlKey || event.metaKey || event.altKey) return;
    if (key === "l") replay.toggleLoop();
    else {
      const action = actionFor(event);
      if (!action || !act(recording, action)) return;
    }
    event.preventDefault();
  };
  addEventListener("keydown", onKey);
  return () => removeEventListener("keydown", onKey);
}

/** False for actions not handled here. */
function act(recording: OpenRecording, action: KeyAction): boolean {
  const { replay } = recording;
  const { sheet, showsSignals } = recording.app;
  const { view, cursor, measure, actions } = replay.viewState;
  switch (action.do) {
    case "extension":
      action.press({ app: recording.app, recording });
      return true;
    case "signals":
      recording.app.showsSignals.value = !recording.app.showsSignals.peek();
      return true;
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
      beginMarker(recording);
      return true;
    case "pan":
      actions.pan(action.windows);
      return true;
    case "step":
      replay.playing.value = false;
      actions.stepSample(action.samples);
      return true;
    case "stepMeasure":
      actions.stepMeasure(action.samples);
      return true;
    case "packet":
      replay.playing.value = false;
      actions.bytes();
      return true;
    case "measure":
      replay.playing.value = false;
      actions.toggleMeasure();
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
      void copyLink(recording);
      return true;
    case "close":
      if (sheet.peek()) sheet.value = undefined;
      else if (showsSignals.peek()) showsSignals.value = false;
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
