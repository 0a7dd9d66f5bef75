/** Handles keys by the table in page/keys.ts. */
import { actionFor, belongsToControl, type KeyAction, nextSpan } from "../page/keys";
import type { App } from "../page/context";
import { VIEW_ONLY } from "../requests/http";
import { isViewOnly } from "../wire/capabilities";
import { showsPlots } from "../page/page-state";
import { shareLive } from "./share";
import { askForRecord, beginNote, mark, toggleRecord } from "./record-button";
import { go, isRemote, type PageName, pagesOf, route } from "../page/route";

export function startKeyboard(app: App): () => void {
  const pageAfter = chords(app);
  const onKey = (event: KeyboardEvent): void => {
    // a dialog has its own keys, and closes on Esc by itself
    if (event.defaultPrevented || app.overlay.value !== undefined || document.querySelector("dialog[open]") !== null)
      return;
    const target = event.target instanceof HTMLElement ? event.target : document.body;
    const type = target instanceof HTMLInputElement ? target.type : "";
    if (belongsToControl(target.tagName, type, target.isContentEditable, event)) return;
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "k") {
      event.preventDefault();
      app.overlay.value = "palette";
      return;
    }
    const page = pageAfter(event);
    if (page !== undefined) {
      event.preventDefault();
      go(page);
      return;
    }
    const action = actionFor(event);
    if (!action) return;
    if (action.do === "help") app.overlay.value = "help";
    else if (isRemote(route.value.page))
      return; // other hosts are not recorded from here
    else if (isViewOnly.value && ["record", "askRecord", "mark", "note"].includes(action.do))
      app.problem.value = VIEW_ONLY;
    else if (action.do === "record") void toggleRecord(app);
    else if (action.do === "askRecord") askForRecord(app);
    else if (route.value.recording !== undefined)
      return; // an open recording has keys of its own
    else if (action.do === "mark") void mark(app);
    else if (action.do === "note") beginNote(app);
    else if (action.do === "close") close(app);
    else if (route.value.page === "live" && showsPlots(app.state.value)) act(action, app);
    else return;
    event.preventDefault();
  };
  addEventListener("keydown", onKey);
  return () => removeEventListener("keydown", onKey);
}

/** How long the second key of "G, then a letter" is awaited. */
const CHORD_MS = 1500;

/** The page of "G, then L". */
function chords(app: App): (event: KeyboardEvent) => PageName | undefined {
  let goPressed = -Infinity;
  return (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return undefined;
    const key = event.key.toLowerCase();
    const waits = event.timeStamp - goPressed < CHORD_MS;
    goPressed = key === "g" ? event.timeStamp : -Infinity;
    return waits ? pagesOf(app).find(({ title }) => title.charAt(0).toLowerCase() === key)?.name : undefined;
  };
}

/** Esc: closes the topmost overlay, then the measuring cursor, then the pinned one. */
function close({ sheet, showsSignals, viewState: { cursor, measure } }: App): void {
  if (sheet.value) sheet.value = undefined;
  else if (showsSignals.value) showsSignals.value = false;
  else if (measure.value !== undefined) measure.value = undefined;
  else if (cursor.value?.kind === "pinned") cursor.value = undefined;
}

function act(action: KeyAction, app: App): void {
  const { view, actions } = app.viewState;
  switch (action.do) {
    case "extension":
      return action.press({ app });
    case "signals":
      app.showsSignals.value = !app.showsSignals.value;
      return;
    case "playPause":
      return view.peek().live ? actions.pause() : actions.live();
    case "pan":
      return actions.pan(action.windows);
    case "step":
      return actions.stepSample(action.samples);
    case "stepMeasure":
      return actions.stepMeasure(action.samples);
    case "measure":
      return actions.toggleMeasure();
    case "packet":
      return actions.bytes();
    case "span":
      return actions.setSpan(nextSpan(view.peek().span, action.longer));
    case "zoom":
      return actions.zoom(action.factor);
    case "fit":
      return actions.fit();
    case "start":
      return actions.toStart();
    case "now":
      return actions.live();
    case "timeBase":
      return actions.toggleTimeBase();
    case "link":
      return void shareLive(app);
    case "series":
      return actions.toggleSeries(action.index, action.alone);
    case "record":
    case "askRecord":
    case "mark":
    case "note":
    case "help":
    case "close":
      return undefined;
  }
}
