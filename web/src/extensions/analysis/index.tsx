/** Analysis of signals: spectrum, spectrogram, Allan deviation; and comparing two devices or recordings. */
import { registerExtension, type Slots } from "../../extension/extension";
import { BAR_CLASS } from "../../pages/top-bar";
import type { ExtensionPress } from "../../page/keys";
import type { App, Deps } from "../../page/context";
import { show, tile } from "../../data/layout";
import { PLOTS_TILE } from "../../data/plot-order";
import { leaves } from "../../data/tiles";
import { panelsOf } from "../../workspace/panels";
import { sessionOf } from "../../workspace/session";
import { Button } from "../../ui/controls/button";
import { Icon } from "../../ui/controls/icons";
import type { RecordingInfo } from "../../wire/recording-types";
import { IconButton } from "../../ui/controls/icon-button";
import { late } from "../../ui/dom/late";
import { COMMON } from "../../texts/common";
import { compareView, comparisonHref, isComparison } from "./compare/sides";
import { TEXT as COMPARE } from "./compare/texts";
import { analysisPanel } from "./panel";
import { TEXT } from "./texts";
import "./layers.css";
import "./panel";

/** All analyses, one at a time. */
const PANEL = analysisPanel("analysis", undefined, 20);
const loading = <div class="app" aria-busy="true" />;
const ComparePage = late(async () => (await import("./compare/page")).ComparePage, loading);

/** Under this width of the page the analysis stands under the plots, px. */
const BESIDE_PX = 1100;

/** Show the analysis beside the plots, where it was last, or hide it. */
function toggle(app: App, deps: Deps): void {
  const session = sessionOf(app, deps.viewState);
  const all = panelsOf(deps);
  session.change((layout) => {
    if (layout.panels[PANEL.id]?.shown) return show(layout, PANEL, false);
    const shown = show(layout, PANEL, true);
    if (shown.tiles && leaves(shown.tiles).includes(PANEL.id)) return shown;
    return tile(shown, PANEL, PLOTS_TILE, innerWidth < BESIDE_PX ? "bottom" : "right", all);
  });
  requestAnimationFrame(() =>
    document
      .querySelector(`[data-panel=${PANEL.id}]`)
      ?.scrollIntoView({ block: innerWidth < BESIDE_PX ? "start" : "nearest" }),
  );
}

function compare({ app, recording }: Omit<ExtensionPress, "isShifted">): void {
  if (recording) {
    const { viewState, detail } = recording.replay;
    compareView(viewState, viewState.view.peek().device ?? "", detail.info.id);
  } else if (app.viewState.view.peek().device !== undefined)
    compareView(app.viewState, app.viewState.view.peek().device ?? "");
}

function AnalysisButton({ app, deps }: Slots["barViews"]) {
  return (
    <IconButton
      icon="wave"
      label={TEXT.analysis}
      word={TEXT.analysis}
      class={BAR_CLASS.overPlots}
      title={TEXT.open}
      onClick={() => toggle(app, deps)}
    />
  );
}

function CompareButton({ app, isLive }: Slots["barViews"]) {
  if (!isLive || !app.device.value) return null;
  return (
    <IconButton
      icon="compare"
      label={COMPARE.compare}
      word={COMPARE.compare}
      class={BAR_CLASS.spareFirst}
      title={COMPARE.open}
      onClick={() => compareView(app.viewState, app.device.value?.id ?? "")}
    />
  );
}

function CompareRecordingButton({ recording }: Slots["recordingActions"]) {
  return (
    <Button
      look="edge"
      icon="compare"
      words={COMPARE.compare}
      title={COMPARE.open}
      onClick={() => compare({ app: recording.app, recording })}
    />
  );
}

function CompareSelectedButton({ infos: [a, b, ...more] }: Slots["selectedRecordings"]) {
  if (!a || !b || more.length > 0) return null;
  const side = ({ id }: RecordingInfo) => ({ source: id, device: "" });
  const place = comparisonHref({ a: side(a), b: side(b), signal: "", signalB: "" });
  return (
    <a class="btn edge" href={place} title={COMPARE.open}>
      <Icon name="compare" />
      {COMPARE.compare}
    </a>
  );
}

registerExtension({
  name: "analysis",
  panels: [
    PANEL,
    analysisPanel("spectrum", "psd", 16),
    analysisPanel("spectrogram", "spectrogram", 17),
    analysisPanel("allan", "allan", 18),
  ],
  addresses: [{ takes: isComparison, View: ComparePage }],
  views: [
    { slot: "barViews", order: 10, View: AnalysisButton },
    { slot: "barViews", order: 20, View: CompareButton },
    { slot: "recordingActions", order: 30, View: CompareRecordingButton },
    { slot: "selectedRecordings", order: 10, View: CompareSelectedButton },
  ],
  keys: [
    {
      key: "a",
      group: COMMON.keysOfMeasuring,
      what: TEXT.key,
      press: ({ app, recording }) => toggle(app, recording?.deps ?? app),
    },
    { key: "d", group: COMMON.keysOfMeasuring, what: COMPARE.key, press: compare },
  ],
});
