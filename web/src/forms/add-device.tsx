/**
 * Add a device by its address, or say how one that is there is read: its key, the unit of its timestamps. The server judges what was typed; what it says, with its hint,
 * stands under the field. A key is sent and forgotten: neither the page nor an answer keeps it.
 */
import { type Signal, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { api, type HowToRead, type Outcome, type Problem } from "../ui/http";
import { Dialog } from "../ui/dialog";
import { Icon } from "../ui/icons";
import { Message } from "../ui/message";

const EXAMPLES: readonly (readonly [source: string, words: string])[] = [
  ["/dev/ttyUSB0", "a serial port, its baud rate found by listening"],
  ["serial:///dev/ttyUSB0?baud=921600", "a serial port at a known rate"],
  ["tcp://192.168.1.20:2000", "a serial server or a device on the network"],
  ["tcp-listen://:2000", "wait for a device to connect"],
  ["udp://:34555", "datagrams to a port"],
  ["twin:xbus", "a simulated MTi; twin:isb an IMX-5, twin:idtp an IDTP device"],
];

const PROTOCOLS: readonly (readonly [value: string, words: string])[] = [
  ["", "Recognised by itself"],
  ["xbus", "Xsens MTi (Xbus)"],
  ["isb", "Inertial Sense (ISB)"],
  ["idtp", "IDTP"],
];

const TIME_UNITS: readonly (readonly [value: string, words: string])[] = [
  ["", "By arrival, usually µs"],
  ["us", "Microseconds"],
  ["ms", "Milliseconds"],
  ["ns", "Nanoseconds"],
  ["s", "Seconds"],
];

const ROTATIONS: readonly (readonly [value: string, words: string])[] = [
  ["enu_from_body", "Body to ENU"],
  ["body_from_enu", "ENU to body"],
];

export interface Begin {
  readonly id: string;
  readonly source: string;
  readonly protocol: string;
  readonly time_unit: string;
  readonly rotation: string;
}

interface Props {
  /** The device whose reading is changed; undefined for a new one. */
  readonly begin: Begin | undefined;
  readonly onClose: () => void;
  /** Called with the id of the device. */
  readonly onAdded: (id: string | undefined) => void;
}

const source = signal("");
const protocol = signal("");
const key = signal("");
const timeUnit = signal("");
const rotation = signal("enu_from_body");
const busy = signal(false);
const problem = signal<Problem | undefined>(undefined);

/** What is wrong with a key as it was typed. */
function wrongKey(text: string): Problem | undefined {
  if (text === "" || (/^[0-9a-f\s]+$/i.test(text) && text.replace(/\s/g, "").length % 2 === 0)) return undefined;
  return { kind: "bad-setting", message: "A key is written in hex digits, two for each byte.", hint: "For example 00112233445566778899aabbccddeeff.", status: 0 };
}

/** Adds the device that the form describes, or changes how the one that is there is read. */
async function send(address: string, begin: Begin | undefined): Promise<Outcome<{ readonly id: string }>> {
  const idtp = isIdtp();
  const how: HowToRead = {
    ...(protocol.value ? { protocol: protocol.value } : {}),
    ...(key.value.trim() ? { key: key.value.trim() } : {}),
    ...(idtp && timeUnit.value !== (begin?.time_unit ?? "") ? { time_unit: timeUnit.value } : {}),
    ...(idtp && rotation.value !== (begin?.rotation || "enu_from_body") ? { rotation: rotation.value } : {}),
  };
  return begin === undefined ? api.addDevice(address, how) : api.readDevice(begin.id, how);
}

function isIdtp(): boolean {
  return protocol.value === "" || protocol.value === "idtp";
}

/** Is there something to send about a device that is there? */
function changed(begin: Begin): boolean {
  return key.value.trim() !== "" || changedHow(begin);
}

/** The same, but for the key. */
function changedHow(begin: Begin): boolean {
  return protocol.value !== begin.protocol || timeUnit.value !== begin.time_unit || rotation.value !== (begin.rotation || "enu_from_body");
}

export function AddDevice({ begin, onClose, onAdded }: Props) {
  const field = useRef<HTMLInputElement>(null);
  const keyField = useRef<HTMLInputElement>(null);
  const focus = (): void => (begin ? keyField : field).current?.focus();
  useEffect(() => {
    problem.value = undefined;
    key.value = "";
    protocol.value = begin?.protocol ?? "";
    timeUnit.value = begin?.time_unit ?? "";
    rotation.value = begin?.rotation || "enu_from_body";
    if (begin) source.value = begin.source;
    focus();
    return () => {
      key.value = "";
      if (begin) source.value = "";
    };
  }, []);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    const address = source.value.trim();
    if (address === "" || busy.value) return;
    problem.value = wrongKey(key.value.trim());
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
    <Dialog title={begin ? "How it is read" : "Add a device"} onClose={onClose}>
      <form class="form" onSubmit={(event) => void submit(event)}>
        <label for="source">Address</label>
        <div class="field">
          <input
            id="source"
            ref={field}
            class="mono"
            value={source}
            onInput={(event) => {
              source.value = event.currentTarget.value;
            }}
            placeholder="/dev/ttyUSB0"
            readOnly={begin !== undefined}
            spellcheck={false}
            autocomplete="off"
            autocapitalize="off"
            aria-describedby={problem.value ? "source-problem" : begin ? undefined : "source-examples"}
            aria-invalid={problem.value !== undefined}
          />
        </div>
        <div class="pair">
          <Choice id="protocol" label="Protocol" of={protocol} choices={PROTOCOLS} />
          {isIdtp() && <KeyField input={keyField} />}
        </div>
        {(protocol.value === "idtp" || begin?.protocol === "idtp") && (
          <div class="pair">
            <Choice id="time-unit" label="Unit of its timestamps" of={timeUnit} choices={TIME_UNITS} />
            <Choice id="rotation" label="Its quaternion turns" of={rotation} choices={ROTATIONS} />
          </div>
        )}
        {problem.value && <Wrong problem={problem.value} />}
        {!begin && <Examples take={take} />}
        <div class="row">
          <button type="button" class="btn" onClick={onClose}>
            Cancel
          </button>
          <button type="submit" class="btn main" disabled={busy.value || source.value.trim() === "" || (begin !== undefined && !changed(begin))}>
            {busy.value ? "Sending…" : !begin ? "Add" : changedHow(begin) ? "Apply" : "Use this key"}
          </button>
        </div>
      </form>
    </Dialog>
  );
}

interface ChoiceProps {
  readonly id: string;
  readonly label: string;
  readonly of: Signal<string>;
  readonly choices: readonly (readonly [value: string, words: string])[];
}

function Choice({ id, label, of, choices }: ChoiceProps) {
  return (
    <div>
      <label for={id}>{label}</label>
      <div class="select">
        <select
          id={id}
          value={of.value}
          onChange={(event) => {
            of.value = event.currentTarget.value;
          }}
        >
          {choices.map(([value, words]) => (
            <option value={value}>{words}</option>
          ))}
        </select>
        <Icon name="down" />
      </div>
    </div>
  );
}

function KeyField({ input }: { readonly input: { current: HTMLInputElement | null } }) {
  return (
    <div>
      <label for="key">Key for Secure frames of IDTP (hex, optional)</label>
      <div class="field">
        <input
          id="key"
          ref={input}
          type="password"
          class="mono"
          value={key}
          onInput={(event) => {
            key.value = event.currentTarget.value;
          }}
          spellcheck={false}
          autocomplete="off"
        />
      </div>
    </div>
  );
}

function Examples({ take }: { readonly take: (example: string) => void }) {
  return (
    <ul class="examples" id="source-examples" aria-label="Examples">
      {EXAMPLES.map(([example, words]) => (
        <li>
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
      <b><Message text={message} /></b>
      {hint !== "" && <p><Message text={hint} /></p>}
    </div>
  );
}
