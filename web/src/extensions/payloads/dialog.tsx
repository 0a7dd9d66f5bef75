/** Defines a vendor's own payload: a short text in TOML, checked by the server; its bytes become plots. */
import { useSignal } from "@preact/signals";
import { Button } from "../../ui/controls/button";
import { api, type HttpProblem } from "../../requests/http";
import { Dialog } from "../../ui/controls/dialog";
import { ProblemNote } from "../../requests/problem-note";
import { protocolOf } from "../../wire/capabilities";
import type { UnknownPayload } from "../../wire/types";
import { linkOf } from "../../page/app-state";
import type { App } from "../../page/context";
import { COMMON } from "../../texts/common";
import { TEXT } from "./texts";
import type { ProtocolCapability } from "../../wire/capability-types";

interface Props {
  readonly app: App;
  readonly payload: UnknownPayload;
  readonly onClose: () => void;
}

export function PayloadDialog({ app, payload, onClose }: Props) {
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const busy = useSignal(false);
  const protocol = app.store.devices.value.find(({ id }) => id === payload.device)?.protocol;
  const family = protocolOf(protocol);
  const option = family?.payload_option ?? "";
  const text = useSignal(family ? initialDefinition(family, payload) : ""); // of the first sample: later ones leave it as typed
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    const device = app.store.devices.value.find(({ id }) => id === payload.device);
    if (!device || busy.value) return;
    busy.value = true;
    const outcome = await api.readDevice(linkOf(device), { [option]: text.value });
    busy.value = false;
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) onClose();
  };
  return (
    <Dialog title={TEXT.definePayload(payload.name)} onClose={onClose}>
      <form class="form" onSubmit={(event) => void submit(event)}>
        <label for="description">{TEXT.payloadFields}</label>
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
          {TEXT.definitionLifetime} <code>{TEXT.fileOption(option.replaceAll("_", "-"))}</code>.
        </p>
        {problem.value && <ProblemNote problem={{ ...problem.value, hint: "" }} />}
        <div class="row">
          <Button words={COMMON.cancel} onClick={onClose} />
          <Button
            changes
            type="submit"
            look="main"
            words={busy.value ? COMMON.sending : TEXT.useDefinition}
            disabled={busy.value}
          />
        </div>
      </form>
    </Dialog>
  );
}

type Template = Pick<ProtocolCapability, "payload_template" | "payload_numbers">;

/** The text for the user to complete: the whole payload as numbers of one type. */
export function initialDefinition(family: Template, { id, size }: Pick<UnknownPayload, "id" | "size">): string {
  const number = family.payload_numbers.find((one) => size % one.size === 0);
  const count = number ? size / number.size : size;
  const values: Readonly<Record<string, string>> = {
    size: String(size),
    id: id.toString(16).toUpperCase().padStart(2, "0"),
    type: number?.name ?? "",
    count: String(count),
  };
  return family.payload_template
    .split("\n")
    .filter((line) => count !== 1 || !line.includes("{count}"))
    .join("\n")
    .replace(/\{(\w+)\}/g, (whole, name: string) => values[name] ?? whole);
}
