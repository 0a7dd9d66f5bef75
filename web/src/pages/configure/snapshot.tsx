/** Actions on a snapshot: view its text, download it, save it under a name, delete it. */
import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Button } from "../../ui/controls/button";
import { Dialog } from "../../ui/controls/dialog";
import type { Model } from "./model";
import { configureApi } from "./api";
import { goTo } from "./view-state";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";

export function SnapshotActs({ model, name }: { readonly model: Model; readonly name: string }) {
  const info = model.snapshots.value.find((snapshot) => snapshot.name === name);
  const text = useSignal<string | undefined>(undefined);
  if (!info) return null;
  const look = async (): Promise<void> => {
    const found = await model.run(configureApi.snapshot(model.id, name));
    if (typeof found === "string") text.value = found;
  };
  const remove = async (): Promise<void> => {
    await model.run(configureApi.deleteSnapshot(model.id, name));
    await model.refresh();
    goTo(model, "compare");
  };
  const ask = (): void => {
    model.page.question.value = {
      title: TEXT.confirmDelete(info.title),
      about: model.fullName,
      words: [TEXT.snapshotDeleteHint],
      caution: "",
      go: TEXT.deleteSnapshot,
      act: () => void remove(),
    };
  };
  return (
    <div class="snapshot-actions text-sm control-row">
      <span class="mid grow">
        <b>{info.title}</b> {info.reason && `· ${info.reason}`} {TEXT.settingCount(info.settings)}
        {info.missing ? TEXT.missingCount(info.missing) : ""}
      </span>
      <Button look="small edge" words={TEXT.view} onClick={() => void look()} />
      <a class="btn small edge" href={configureApi.snapshotUrl(model.id, name)} download={`${name}.yaml`}>
        {COMMON.download}
      </a>
      <Button changes look="small" words={COMMON.delete} onClick={ask} />
      {text.value !== undefined && (
        <Dialog title={name} onClose={() => (text.value = undefined)}>
          <pre class="yaml" tabIndex={0}>
            {text.value}
          </pre>
        </Dialog>
      )}
    </div>
  );
}

/** Save the device's present values under a name. */
export function KeepButton({ model }: { readonly model: Model }) {
  const naming = useSignal<string | undefined>(undefined);
  return (
    <>
      <Button
        changes
        look="edge"
        words={TEXT.saveAs}
        disabled={!model.isRead.value}
        onClick={() => (naming.value = "")}
      />
      {naming.value !== undefined && <Naming model={model} naming={naming} />}
    </>
  );
}

function Naming({ model, naming }: { readonly model: Model; readonly naming: Signal<string | undefined> }) {
  const field = useRef<HTMLInputElement>(null);
  useEffect(() => field.current?.focus(), []);
  const close = (): void => {
    naming.value = undefined;
  };
  const keep = async (event: Event): Promise<void> => {
    event.preventDefault();
    const title = naming.value?.trim() ?? "";
    if (title === "") return;
    close();
    if (await model.run(configureApi.keepSnapshot(model.id, title))) await model.refresh();
  };
  return (
    <Dialog title={TEXT.saveAsHint} onClose={close}>
      <form class="form" onSubmit={(event) => void keep(event)}>
        <label for="snapshot-name">{COMMON.name}</label>
        <div class="field">
          <input
            id="snapshot-name"
            ref={field}
            value={naming.value}
            maxLength={120}
            placeholder={TEXT.namePlaceholder}
            autocomplete="off"
            onInput={(event) => (naming.value = event.currentTarget.value)}
          />
        </div>
        <div class="row">
          <Button words={COMMON.cancel} onClick={close} />
          <Button type="submit" look="main" words={COMMON.save} disabled={naming.value?.trim() === ""} />
        </div>
      </form>
    </Dialog>
  );
}
