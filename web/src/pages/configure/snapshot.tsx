/** What can be done with a snapshot: look at its text, take it away as a file, keep it under a name, delete it. */
import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Dialog } from "../../ui/dialog";
import { type Model, viewOnly } from "./model";
import { server } from "./api";
import { goTo, question } from "./view-state";

export function SnapshotActs({ model, name }: { readonly model: Model; readonly name: string }) {
  const info = model.snapshots.value.find((snapshot) => snapshot.name === name);
  const text = useSignal<string | undefined>(undefined);
  if (!info) return null;
  const look = async (): Promise<void> => {
    const found = await model.run(server.snapshotText(model.id, name));
    if (found !== undefined) text.value = found;
  };
  const remove = async (): Promise<void> => {
    await model.run(server.deleteSnapshot(model.id, name));
    await model.refresh();
    goTo(model, "compare");
  };
  const ask = (): void => {
    question.value = { title: `Delete “${info.title}”?`, words: ["The snapshot is gone then; the device stays as it is."], caution: "", go: "Delete it", act: () => void remove() };
  };
  return (
    <div class="snapacts">
      <span class="mid grow">
        <b>{info.title}</b> {info.reason && `· ${info.reason}`} · {info.settings} settings{info.missing ? `, ${info.missing} missing` : ""}
      </span>
      <button type="button" class="btn small edge" onClick={() => void look()}>
        View
      </button>
      <a class="btn small edge" href={server.snapshotUrl(model.id, name)} download={`${name}.yaml`}>
        Download
      </a>
      <button type="button" class="btn small" disabled={viewOnly.value} onClick={ask}>
        Delete
      </button>
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

/** Keep what the device has now, under a name. */
export function KeepButton({ model }: { readonly model: Model }) {
  const naming = useSignal<string | undefined>(undefined);
  return (
    <>
      <button type="button" class="btn edge" disabled={viewOnly.value || !model.isRead.value} onClick={() => (naming.value = "")}>
        Keep as …
      </button>
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
    if (await model.run(server.keepSnapshot(model.id, title))) await model.refresh();
  };
  return (
    <Dialog title="Keep these settings under a name" onClose={close}>
      <form class="form" onSubmit={(event) => void keep(event)}>
        <label for="snapshot-name">Name</label>
        <div class="field">
          <input id="snapshot-name" ref={field} value={naming.value} maxLength={120} placeholder="New mast fitted" autocomplete="off" onInput={(event) => (naming.value = event.currentTarget.value)} />
        </div>
        <div class="row">
          <button type="button" class="btn" onClick={close}>
            Cancel
          </button>
          <button type="submit" class="btn main" disabled={naming.value?.trim() === ""}>
            Keep
          </button>
        </div>
      </form>
    </Dialog>
  );
}
