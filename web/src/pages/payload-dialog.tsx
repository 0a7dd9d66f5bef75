/** Says what a vendor's own payload means: a short text in TOML, which the server judges; what was only bytes becomes plots. */
import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { descriptionOf } from "../panels/hex";
import { api, type Problem } from "../ui/http";
import { Dialog } from "../ui/dialog";
import { Message } from "../ui/message";
import type { RawPayload } from "../wire/types";
import { type App, linkOf } from "./app-state";

const text = signal("");
const problem = signal<Problem | undefined>(undefined);
const busy = signal(false);

interface Props {
  readonly app: App;
  readonly payload: RawPayload;
  readonly onClose: () => void;
}

export function Describe({ app, payload, onClose }: Props) {
  useEffect(() => {
    text.value = descriptionOf(payload.id, payload.size);
    problem.value = undefined;
  }, []);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    const device = app.store.devices.value.find(({ id }) => id === payload.device);
    if (!device || busy.value) return;
    busy.value = true;
    const outcome = await api.readDevice(linkOf(device), { schema: text.value });
    busy.value = false;
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) onClose();
  };
  return (
    <Dialog title={`Describe ${payload.name}`} onClose={onClose}>
      <form class="form" onSubmit={(event) => void submit(event)}>
        <label for="description">Its fields, in the order of the bytes</label>
        <textarea
          id="description"
          class="mono"
          rows={14}
          value={text}
          onInput={(event) => {
            text.value = event.currentTarget.value;
          }}
          spellcheck={false}
          aria-invalid={problem.value !== undefined}
          aria-describedby="description-hint"
        />
        <p class="hint" id="description-hint">
          Kept until imuscope stops. For good, put the same text into a file and start with <code>--schema FILE</code>.
        </p>
        {problem.value && (
          <div class="problem" role="alert">
            <b><Message text={problem.value.message} /></b>
          </div>
        )}
        <div class="row">
          <button type="button" class="btn" onClick={onClose}>
            Cancel
          </button>
          <button type="submit" class="btn main" disabled={busy.value}>
            {busy.value ? "Sending…" : "Use this description"}
          </button>
        </div>
      </form>
    </Dialog>
  );
}
