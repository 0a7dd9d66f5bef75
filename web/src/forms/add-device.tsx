/**
 * Add a device by its address, or change how an existing one is decoded: its key, the unit of its timestamps. The server checks the
 * input; its message and hint are shown under the field. A key is sent and dropped: neither the page nor an answer stores it.
 */
import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { api, type HowToRead, type Outcome, type Problem } from "../ui/http";
import { Dialog } from "../ui/dialog";
import { Icon } from "../ui/icons";
import { Message } from "../ui/message";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/forms";
import { capabilities } from "../wire/capabilities";
import type { DecodeOptionChoice, DecodeOptionInput, DecodeOptionName } from "../wire/capability-types";

export interface Begin {
  readonly id: string;
  readonly source: string;
  readonly protocol: string;
  /** Options of its decoding, "" where none was given; a key is never included. */
  readonly options: Readonly<Partial<Record<DecodeOptionName, string>>>;
}

interface Props {
  /** The device whose decoding is changed; undefined for a new one. */
  readonly begin: Begin | undefined;
  readonly onClose: () => void;
  /** Called with the id of the device. */
  readonly onAdded: (id: string | undefined) => void;
}

const source = signal("");
const protocol = signal("");
/** Decoding options, as far as changed here. */
const options = signal<Readonly<Partial<Record<DecodeOptionName, string>>>>({});
const busy = signal(false);
const problem = signal<Problem | undefined>(undefined);

/** Problem of a typed key. */
function wrongKey(text: string): Problem | undefined {
  if (text === "" || (/^[0-9a-f\s]+$/i.test(text) && text.replace(/\s/g, "").length % 2 === 0)) return undefined;
  return {
    kind: "bad-setting",
    message: TEXT.keyFormat,
    hint: TEXT.keyExample,
    status: 0,
  };
}

/** Adds the device described by the form, or changes the decoding of an existing one. */
async function send(address: string, begin: Begin | undefined): Promise<Outcome<{ readonly id: string }>> {
  const said = inputsFor(protocol.value, begin?.protocol ?? "").filter((input) => isChanged(input, begin));
  const how = {
    ...(protocol.value ? { protocol: protocol.value } : {}),
    ...Object.fromEntries(said.map((input) => [input.name, valueOf(input, begin)])),
  } as HowToRead; // the server said which values there are
  return begin === undefined ? api.addDevice(address, how) : api.readDevice(begin.id, how);
}

/** Options for a device of this protocol; while none is chosen, the early ones, and those of the protocol it `was`. */
function inputsFor(name: string, was: string): readonly DecodeOptionInput[] {
  const inputs = capabilities.value.protocols.flatMap((one) =>
    one.options.filter(({ early }) => one.name === name || (name === "" && (early || one.name === was))),
  );
  return [...new Map(inputs.map((input) => [input.name, input])).values()];
}

/** Value of a field of the form. */
function valueOf(input: DecodeOptionInput, begin: Begin | undefined): string {
  const value = options.value[input.name] ?? (begin?.options[input.name] || input.default);
  return isKey(input) ? value.trim() : value;
}

const isKey = ({ choices }: DecodeOptionInput): boolean => choices.length === 0;

function isChanged(input: DecodeOptionInput, begin: Begin | undefined): boolean {
  return valueOf(input, begin) !== (begin?.options[input.name] || input.default);
}

/** Whether there are changes to send for an existing device. */
function changed(begin: Begin): boolean {
  return changedHow(begin) || inputsFor(protocol.value, begin.protocol).some((input) => isChanged(input, begin));
}

/** The same, without the key. */
function changedHow(begin: Begin): boolean {
  const inputs = inputsFor(protocol.value, begin.protocol);
  return protocol.value !== begin.protocol || inputs.some((input) => !isKey(input) && isChanged(input, begin));
}

export function AddDevice({ begin, onClose, onAdded }: Props) {
  const field = useRef<HTMLInputElement>(null);
  const keyField = useRef<HTMLInputElement>(null);
  const focus = (): void => (begin ? keyField : field).current?.focus();
  // biome-ignore lint/correctness/useExhaustiveDependencies: the fields are filled once, as the dialog opens
  useEffect(() => {
    problem.value = undefined;
    options.value = {};
    protocol.value = begin?.protocol ?? "";
    if (begin) source.value = begin.source;
    focus();
    return () => {
      options.value = {};
      if (begin) source.value = "";
    };
  }, []);
  const inputs = inputsFor(protocol.value, begin?.protocol ?? "");
  const choices = inputs.filter((input) => !isKey(input));
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    const address = source.value.trim();
    if (address === "" || busy.value) return;
    const keys = inputs.filter(isKey).map((input) => wrongKey(valueOf(input, begin)));
    problem.value = keys.find((one) => one !== undefined);
    if (problem.value) return focus();
    busy.value = true;
    const outcome = await send(address, begin);
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
          {inputs.filter(isKey).map((input) => (
            <KeyField key={input.name} input={input} field={keyField} />
          ))}
        </div>
        {choices.length > 0 && (
          <div class="pair">
            {choices.map((input) => (
              <Choice
                key={input.name}
                id={input.name}
                label={input.title}
                value={valueOf(input, begin)}
                onChange={(value) => say(input, value)}
                choices={input.choices}
              />
            ))}
          </div>
        )}
        {problem.value && <Wrong problem={problem.value} />}
        {!begin && <Examples take={take} />}
        <div class="row">
          <button type="button" class="btn" onClick={onClose}>
            {COMMON.cancel}
          </button>
          <button
            type="submit"
            class="btn main"
            disabled={busy.value || source.value.trim() === "" || (begin !== undefined && !changed(begin))}
          >
            {busy.value ? COMMON.sending : !begin ? TEXT.add : changedHow(begin) ? COMMON.apply : TEXT.useKey}
          </button>
        </div>
      </form>
    </Dialog>
  );
}

function say({ name }: DecodeOptionInput, value: string): void {
  options.value = { ...options.value, [name]: value };
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
      <div class="select">
        <select id={id} value={value} onChange={(event) => onChange(event.currentTarget.value)}>
          {choices.map((one) => (
            <option key={one.value} value={one.value}>
              {one.words}
            </option>
          ))}
        </select>
        <Icon name="down" />
      </div>
    </div>
  );
}

interface KeyFieldProps {
  readonly input: DecodeOptionInput;
  readonly field: { current: HTMLInputElement | null };
}

function KeyField({ input, field }: KeyFieldProps) {
  return (
    <div>
      <label for={input.name}>{input.title}</label>
      <div class="field">
        <input
          id={input.name}
          ref={field}
          type="password"
          class="mono"
          value={options.value[input.name] ?? ""}
          onInput={(event) => say(input, event.currentTarget.value)}
          spellcheck={false}
          autocomplete="off"
        />
      </div>
    </div>
  );
}

function Examples({ take }: { readonly take: (example: string) => void }) {
  return (
    <ul class="examples" id="source-examples" aria-label={TEXT.examples}>
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

function Wrong({ problem: { message, hint } }: { readonly problem: Problem }) {
  return (
    <div class="problem" id="source-problem" role="alert">
      <b>
        <Message text={message} />
      </b>
      {hint !== "" && (
        <p>
          <Message text={hint} />
        </p>
      )}
    </div>
  );
}
