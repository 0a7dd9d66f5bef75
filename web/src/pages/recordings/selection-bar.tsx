/** What can be done with several recordings at once; under the list while more than one is selected. */
import { useSignal } from "@preact/signals";
import { recordingsApi } from "../../recordings/api";
import { takeExport } from "../../recordings/exporting";
import { bytes } from "../../recordings/library-filter";
import type { RecordingInfo } from "../../wire/recording-types";
import { capabilities, isViewOnly } from "../../wire/capabilities";
import { Button } from "../../ui/controls/button";
import { Select } from "../../ui/controls/choices";
import { IconButton } from "../../ui/controls/icon-button";
import { Slot } from "../../extension/extension";
import { run } from "../../page/app-state";
import type { App } from "../../page/context";
import { formatsOf } from "./export-dialog";
import { libraryOf } from "./library-store";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/recordings";

declare module "../../extension/extension" {
  interface Slots {
    /** Actions on several recordings of the library. */
    readonly selectedRecordings: { readonly app: App; readonly infos: readonly RecordingInfo[] };
  }
}

export function SelectionBar({ app }: { readonly app: App }) {
  const library = libraryOf(app);
  const infos = library.several.value;
  const isMany = infos.length > 1 || (library.isPicking.value && infos.length > 0);
  if (!isMany) return null;
  const { value, unit } = bytes(infos.reduce((sum, { size }) => sum + size, 0));
  const kept = infos.filter(({ deleted, recording }) => deleted === null && !recording);
  return (
    <div class="selection-bar" role="region" aria-label={TEXT.selection}>
      <IconButton icon="close" label={TEXT.clearSelection} onClick={() => library.pickAll([])} />
      <b>
        {TEXT.selectedCount(infos.length)}{" "}
        <span class="unit">
          {value} {unit}
        </span>
      </b>
      {kept.length > 0 && (
        <>
          <Slot name="selectedRecordings" with={{ app, infos: kept }} />
          <TagForm app={app} infos={kept} />
          <ExportForm app={app} infos={kept} />
          <Button
            changes
            look="edge"
            icon="trash"
            words={COMMON.delete}
            title={TEXT.canBeRestoredFor7Days}
            onClick={() => void library.remove(...kept)}
          />
        </>
      )}
    </div>
  );
}

interface Props {
  readonly app: App;
  readonly infos: readonly RecordingInfo[];
}

function TagForm({ app, infos }: Props) {
  const library = libraryOf(app);
  const word = useSignal("");
  const add = (event: Event): void => {
    event.preventDefault();
    const tag = word.value.trim();
    word.value = "";
    if (tag !== "")
      for (const info of infos) library.edit(info, ({ tags }) => ({ tags: [...new Set([...tags, tag])] }));
  };
  return (
    <form class="field" onSubmit={add}>
      <input
        aria-label={TEXT.addTagToAll}
        placeholder={TEXT.addTagToAll}
        disabled={isViewOnly.value}
        value={word.value}
        maxLength={40}
        onInput={(event) => (word.value = event.currentTarget.value)}
      />
    </form>
  );
}

/** Each becomes a file of its own, one after the other; the page downloads them as they are made. */
function ExportForm({ app, infos }: Props) {
  const formats = formatsOf(capabilities.value.exports, { devices: infos.flatMap(({ devices }) => devices) });
  const offered = formats.filter(({ single }) => !single);
  const format = useSignal(offered[0]?.name ?? "");
  const go = async (): Promise<void> => {
    for (const { id } of infos) {
      const range = { t0: null, t1: null, channels: null, device: "", base: "device", units: "shown" } as const;
      const job = await run(app, recordingsApi.export(id, { format: format.peek(), ...range }));
      if (job === undefined) return; // the reason is in a band
      takeExport(app)(job);
    }
  };
  return (
    <span class="export-all">
      <Select
        label={TEXT.format}
        value={format.value}
        options={offered.map(({ name, title }) => [name, title])}
        onChoose={(name) => (format.value = name)}
      />
      <Button changes look="edge" icon="share" words={TEXT.exportAll} onClick={() => void go()} />
    </span>
  );
}
