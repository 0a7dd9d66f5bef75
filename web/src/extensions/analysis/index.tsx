/** Analysis of signals: spectrum, spectrogram, Allan deviation; and comparing two devices or recordings. */
import { registerExtension, type Slots } from "../../extension/extension";
import { BAR_CLASS } from "../../pages/top-bar";
import type { ExtensionPress } from "../../page/keys";
import type { LiveDialogProps, App } from "../../page/context";
import type { RecordingDialogProps } from "../../pages/recordings/open-recording";
import { recordingTitle } from "../../recordings/library-filter";
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

const loading = <div class="app" aria-busy="true" />;
const ComparePage = late(async () => (await import("./compare/page")).ComparePage, loading);
const AnalysisDialog = late(async () => (await import("./dialog")).AnalysisDialog);

const open = (app: App): void => void (app.overlay.value = "analysis/dialog");

function compare({ app, recording }: Omit<ExtensionPress, "isShifted">): void {
  if (recording) {
    const { viewState, detail } = recording.replay;
    compareView(viewState, viewState.view.peek().device ?? "", detail.info.id);
  } else if (app.viewState.view.peek().device !== undefined)
    compareView(app.viewState, app.viewState.view.peek().device ?? "");
}

function AnalysisButton({ app }: Slots["barViews"]) {
  return (
    <IconButton
      icon="wave"
      label={TEXT.analysis}
      class={BAR_CLASS.overPlots}
      title={TEXT.open}
      onClick={() => open(app)}
    />
  );
}

function CompareButton({ app, isLive }: Slots["barViews"]) {
  if (!isLive || !app.device.value) return null;
  return (
    <IconButton
      icon="compare"
      label={COMPARE.compare}
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

function Live({ app, device, onClose }: LiveDialogProps) {
  return <AnalysisDialog deps={app} source={device.id} title={device.name} prefix="" isLive onClose={onClose} />;
}

function Recording({ recording: { replay, deps }, onClose }: RecordingDialogProps) {
  const { info, devices } = replay.detail;
  const device = replay.viewState.device.value;
  return (
    <AnalysisDialog
      key={device}
      deps={deps}
      source={info.id}
      title={recordingTitle(info)}
      prefix={devices.length > 1 ? `${device}/` : ""}
      isLive={false}
      onClose={onClose}
    />
  );
}

registerExtension({
  name: "analysis",
  panels: [
    // All analyses, one at a time: workspaces and links of earlier versions have it. It is offered where it is shown only; the panels of
    // one analysis each take its place.
    {
      ...analysisPanel("analysis", undefined, 20),
      applies: ({ viewState }) => viewState.layout.value.panels["analysis"]?.shown === true,
    },
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
  dialogs: [{ overlay: "analysis/dialog", Live, Recording }],
  keys: [
    { key: "a", group: COMMON.keysOfMeasuring, what: TEXT.key, press: ({ app }) => open(app) },
    { key: "d", group: COMMON.keysOfMeasuring, what: COMPARE.key, press: compare },
  ],
});
