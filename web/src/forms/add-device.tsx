/**
 * Add a device by its address, or give the key of one that is there. The server judges what was typed; what it says, with its hint,
 * stands under the field. A key is sent and forgotten: neither the page nor an answer keeps it.
 */
import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { api, type HowToRead, type Outcome, type Problem } from "../ui/api";
import { Dialog } from "../ui/dialog";
import { Icon } from "../ui/icons";

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

interface Props {
  /** The device that a key is given for; undefined for a new one. */
  readonly begin: { readonly id: string; readonly source: string; readonly protocol: string } | undefined;
  readonly onClose: () => void;
  /** Called with the id of the device. */
  readonly onAdded: (id: string | undefined) => void;
}

const source = signal("");
const protocol = signal("");
const key = signal("");
const busy = signal(false);
const problem = signal<Problem | undefined>(undefined);

/** What is wrong with a key as it was typed. */
function wrongKey(text: string): Problem | undefined {
  if (text === "" || (/^[0-9a-f\s]+$/i.test(text) && text.replace(/\s/g, "").length % 2 === 0)) return undefined;
  return { kind: "bad-setting", message: "A key is written in hex digits, two for each byte.", hint: "For example 00112233445566778899aabbccddeeff.", status: 0 };
}

/** Adds the device that the form describes, or changes how the one that is there is read. */
async function send(address: string, id: string | undefined): Promise<Outcome<{ readonly id: string }>> {
  const how: HowToRead = {
    ...(protocol.value ? { protocol: protocol.value } : {}),
    ...(key.value.trim() ? { key: key.value.trim() } : {}),
  };
  return id === undefined ? api.addDevice(address, how) : api.readDevice(id, how);
}

export function AddDevice({ begin, onClose, onAdded }: Props) {
  const field = useRef<HTMLInputElement>(null);
  const keyField = useRef<HTMLInputElement>(null);
  const focus = (): void => (begin ? keyField : field).current?.focus();
  useEffect(() => {
    problem.value = undefined;
    key.value = "";
    protocol.value = begin?.protocol ?? "";
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
    const outcome = await send(address, begin?.id);
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
    <Dialog title={begin ? "Give the key" : "Add a device"} onClose={onClose}>
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
          <ProtocolChoice />
          {(protocol.value === "" || protocol.value === "idtp") && <KeyField input={keyField} />}
        </div>
        {problem.value && <Wrong problem={problem.value} />}
        {!begin && <Examples take={take} />}
        <div class="row">
          <button type="button" class="btn" onClick={onClose}>
            Cancel
          </button>
          <button type="submit" class="btn main" disabled={busy.value || source.value.trim() === "" || (begin !== undefined && key.value.trim() === "")}>
            {busy.value ? "Sending…" : begin ? "Use this key" : "Add"}
          </button>
        </div>
      </form>
    </Dialog>
  );
}

function ProtocolChoice() {
  return (
    <div>
      <label for="protocol">Protocol</label>
      <div class="select">
        <select
          id="protocol"
          value={protocol.value}
          onChange={(event) => {
            protocol.value = event.currentTarget.value;
          }}
        >
          {PROTOCOLS.map(([value, words]) => (
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
      <b>{message}</b>
      {hint !== "" && <p>{hint}</p>}
    </div>
  );
}
