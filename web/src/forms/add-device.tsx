/**
 * Add a device by its address, or change how an existing one is decoded: its key, the unit of its timestamps. The server checks the
 * input; its message and hint are shown under the field. A key is sent and dropped: neither the page nor an answer stores it.
 */
import { type Signal, signal, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { Button } from "../ui/controls/button";
import { Select } from "../ui/controls/choices";
import { api, type HowToRead, type Outcome, type HttpProblem } from "../requests/http";
import { Dialog } from "../ui/controls/dialog";
import { ProblemNote } from "../requests/problem-note";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/forms";
import { capabilities } from "../wire/capabilities";
import type { DecodeOptionChoice, DecodeOptionInput } from "../wire/capability-types";

export interface Begin {
  readonly id: string;
  readonly source: string;
  readonly protocol: string;
  /** The given options of its decoding; a secret is never included. */
  readonly options: Readonly<Record<string, string>>;
}

interface Props {
  /** The device whose decoding is changed; undefined for a new one. */
  readonly begin: Begin | undefined;
  /** The address typed for a new device; it stays while the dialog is closed. */
  readonly address: Signal<string>;
  readonly onClose: () => void;
  /** Called with the id of the device. */
  readonly onAdded: (id: string | undefined) => void;
}

/** Problem of a typed text, before it is sent. */
function malformed(input: DecodeOptionInput, text: string): HttpProblem | undefined {
  if (text === "" || input.pattern === "" || new RegExp(`^(?:${input.pattern})$`).test(text)) return undefined;
  const hint = input.example === "" ? "" : TEXT.example(input.example);
  return { kind: "bad-setting", message: input.malformed, hint, status: 0 };
}

const isSecret = ({ kind }: DecodeOptionInput): boolean => kind === "secret";

/** Content of the form. */
class Entry {
  readonly source: Signal<string>;
  readonly protocol: Signal<string>;
  /** Decoding options, as far as changed here. */
  readonly #options = signal<Readonly<Record<string, string>>>({});

  constructor(
    readonly begin: Begin | undefined,
    address: Signal<string>,
  ) {
    this.source = begin ? signal(begin.source) : address;
    this.protocol = signal(begin?.protocol ?? "");
  }

  /** Options for a device of this protocol; while none is chosen, the early ones, and those of the protocol it was. */
  get inputs(): readonly DecodeOptionInput[] {
    const [name, was] = [this.protocol.value, this.begin?.protocol ?? ""];
    const inputs = capabilities.value.protocols.flatMap((one) =>
      one.options.filter(({ early }) => one.name === name || (name === "" && (early || one.name === was))),
    );
    return [...new Map(inputs.map((input) => [input.name, input])).values()];
  }

  /** What was typed for an option; "" for nothing. */
  typed({ name }: DecodeOptionInput): string {
    return this.#options.value[name] ?? "";
  }

  /** Text of an option, as typed. */
  textOf(input: DecodeOptionInput): string {
    return this.#options.value[input.name] ?? (this.begin?.options[input.name] || input.default);
  }

  valueOf(input: DecodeOptionInput): string {
    return isSecret(input) || input.kind === "text" ? this.textOf(input).trim() : this.textOf(input);
  }

  set({ name }: DecodeOptionInput, value: string): void {
    this.#options.value = { ...this.#options.value, [name]: value };
  }

  /** Whether there are changes to send for an existing device. */
  get isChanged(): boolean {
    return this.isChangedBesideSecrets || this.inputs.some((input) => this.#isSet(input));
  }

  get isChangedBesideSecrets(): boolean {
    if (this.begin && this.protocol.value !== this.begin.protocol) return true;
    return this.inputs.some((input) => !isSecret(input) && this.#isSet(input));
  }

  /** Add the described device, or change the decoding of an existing one. */
  async send(): Promise<Outcome<{ readonly id: string }>> {
    const said = this.inputs.filter((input) => this.#isSet(input));
    const how: HowToRead = {
      ...(this.protocol.value ? { protocol: this.protocol.value } : {}),
      ...Object.fromEntries(said.map((input) => [input.name, this.#sent(input)])),
    };
    return this.begin === undefined ? api.addDevice(this.source.value.trim(), how) : api.readDevice(this.begin.id, how);
  }

  #sent(input: DecodeOptionInput): string | boolean {
    return input.kind === "flag" ? this.valueOf(input) !== "" : this.valueOf(input);
  }

  #isSet(input: DecodeOptionInput): boolean {
    return this.valueOf(input) !== (this.begin?.options[input.name] || input.default);
  }
}

export function AddDevice({ begin, address, onClose, onAdded }: Props) {
  const entry = useMemo(() => new Entry(begin, address), [begin, address]);
  const { source, protocol, inputs } = entry;
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const busy = useSignal(false);
  const field = useRef<HTMLInputElement>(null);
  const keyField = useRef<HTMLInputElement>(null);
  const focus = (): void => (begin ? keyField : field).current?.focus();
  // biome-ignore lint/correctness/useExhaustiveDependencies: focused once, as the dialog opens
  useEffect(focus, []);
  const others = inputs.filter((input) => !isSecret(input));
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    if (source.value.trim() === "" || busy.value) return;
    const problems = inputs.map((input) => malformed(input, entry.valueOf(input)));
    problem.value = problems.find((one) => one !== undefined);
    if (problem.value) return focus();
    busy.value = true;
    const outcome = await entry.send();
    busy.value = false;
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) {
      focus();
      return;
    }
    source.value = "";
    onAdded(outcome.value?.id);
  };
  const take = (example: string): void => {
    source.value = example;
    field.current?.focus();
  };
  return (
    <Dialog title={begin ? TEXT.decodeOptions : COMMON.addADevice} onClose={onClose}>
      <form class="form" onSubmit={(event) => void submit(event)}>
        <label for="source">{TEXT.address}</label>
        <div class="field">
          <input
            id="source"
            ref={field}
            class="mono"
            value={source}
            onInput={(event) => {
              source.value = event.currentTarget.value;
            }}
            placeholder={TEXT.addressPlaceholder}
            readOnly={begin !== undefined}
            spellcheck={false}
            autocomplete="off"
            autocapitalize="off"
            aria-describedby={problem.value ? "source-problem" : begin ? undefined : "source-examples"}
            aria-invalid={problem.value !== undefined}
          />
        </div>
        <div class="pair">
          <Choice
            id="protocol"
            label={TEXT.protocol}
            value={protocol.value}
            onChange={(value) => (protocol.value = value)}
            choices={[
              { value: "", words: TEXT.detectAutomatically },
              ...capabilities.value.protocols.map(({ name, title }) => ({ value: name, words: title })),
            ]}
          />
          {inputs.filter(isSecret).map((input) => (
            <SecretInput key={input.name} entry={entry} input={input} field={keyField} />
          ))}
        </div>
        {others.length > 0 && (
          <div class="pair">
            {others.map((input) => (
              <OptionInput key={input.name} entry={entry} input={input} />
            ))}
          </div>
        )}
        {problem.value && <ProblemNote id="source-problem" problem={problem.value} />}
        {!begin && <Examples take={take} />}
        <div class="row">
          <Button words={COMMON.cancel} onClick={onClose} />
          <Button
            changes
            type="submit"
            look="main"
            words={
              busy.value
                ? COMMON.sending
                : !begin
                  ? TEXT.add
                  : entry.isChangedBesideSecrets
                    ? COMMON.apply
                    : TEXT.useKey
            }
            disabled={busy.value || source.value.trim() === "" || (begin !== undefined && !entry.isChanged)}
          />
        </div>
      </form>
    </Dialog>
  );
}

interface ChoiceProps {
  readonly id: string;
  readonly label: string;
  readonly value: string;
  readonly onChange: (value: string) => void;
  readonly choices: readonly DecodeOptionChoice[];
}

function Choice({ id, label, value, onChange, choices }: ChoiceProps) {
  return (
    <div>
      <label for={id}>{label}</label>
      <Select id={id} value={value} options={choices.map((one) => [one.value, one.words])} onChoose={onChange} />
    </div>
  );
}

const FLAG: readonly DecodeOptionChoice[] = [
  { value: "", words: TEXT.no },
  { value: "1", words: TEXT.yes },
];

interface OptionProps {
  readonly entry: Entry;
  readonly input: DecodeOptionInput;
}

/** Input of an option that is not a secret. */
function OptionInput({ entry, input }: OptionProps) {
  if (input.kind === "text" || input.kind === "file") return <TextInput entry={entry} input={input} />;
  return (
    <Choice
      id={input.name}
      label={input.title}
      value={entry.valueOf(input)}
      onChange={(value) => entry.set(input, value)}
      choices={input.kind === "flag" ? FLAG : input.choices}
    />
  );
}

function TextInput({ entry, input }: OptionProps) {
  const common = {
    id: input.name,
    class: "mono",
    value: entry.textOf(input),
    onInput: ({ currentTarget }: { readonly currentTarget: { readonly value: string } }) =>
      entry.set(input, currentTarget.value),
    spellcheck: false,
  };
  return (
    <div>
      <label for={input.name}>{input.title}</label>
      <div class="field">{input.kind === "file" ? <textarea rows={4} {...common} /> : <input {...common} />}</div>
    </div>
  );
}

interface SecretProps extends OptionProps {
  readonly field: { current: HTMLInputElement | null };
}

function SecretInput({ entry, input, field }: SecretProps) {
  return (
    <div>
      <label for={input.name}>{input.title}</label>
      <div class="field">
        <input
          id={input.name}
          ref={field}
          type="password"
          class="mono"
          value={entry.typed(input)}
          onInput={(event) => entry.set(input, event.currentTarget.value)}
          spellcheck={false}
          autocomplete="off"
        />
      </div>
    </div>
  );
}

function Examples({ take }: { readonly take: (example: string) => void }) {
  return (
    <ul class="examples dim text-xs" id="source-examples" aria-label={TEXT.examples}>
      {capabilities.value.links
        .flatMap(({ examples }) => examples)
        .map(({ source: example, words }) => (
          <li key={example}>
            <button type="button" onClick={() => take(example)}>
              {example}
            </button>
            <span>{words}</span>
          </li>
        ))}
    </ul>
  );
}
