/** Evidence: what is on screen as one file that opens without a network. */
import { registerExtension, type Slots } from "../../extension/extension";
import { BAR_CLASS } from "../../pages/top-bar";
import type { App } from "../../page/context";
import { Button } from "../../ui/controls/button";
import { IconButton } from "../../ui/controls/icon-button";
import { late } from "../../ui/dom/late";
import { COMMON } from "../../texts/common";
import { TEXT } from "./texts";
import "./layers.css";

const open = (app: App): void => void (app.overlay.value = "evidence/dialog");

function BarButton({ app }: Slots["barShare"]) {
  return (
    <IconButton
      icon="paper"
      label={TEXT.evidence}
      word={TEXT.word}
      class={BAR_CLASS.spare}
      title={TEXT.hintOfButton}
      onClick={() => open(app)}
    />
  );
}

function RecordingButton({ recording }: Slots["recordingActions"]) {
  return (
    <Button
      look="edge"
      icon="paper"
      words={TEXT.evidence}
      title={TEXT.hintOfButton}
      onClick={() => open(recording.app)}
    />
  );
}

function MemoryButton({ app, disabled }: Slots["memoryActions"]) {
  return <Button look="edge" icon="paper" words={TEXT.evidence} disabled={disabled} onClick={() => open(app)} />;
}

registerExtension({
  name: "evidence",
  views: [
    { slot: "barShare", order: 10, View: BarButton },
    { slot: "recordingActions", order: 10, View: RecordingButton },
    { slot: "memoryActions", order: 10, View: MemoryButton },
  ],
  dialogs: [
    {
      overlay: "evidence/dialog",
      Live: late(async () => (await import("./dialog")).LiveEvidence),
      Recording: late(async () => (await import("./dialog")).RecordingEvidence),
    },
  ],
  keys: [{ key: "e", group: COMMON.keysOfRecording, before: "C", what: TEXT.key, press: ({ app }) => open(app) }],
});
