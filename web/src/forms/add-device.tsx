/** Add a device by its address. The server judges the address; what it says, with its hint, stands under the field. */
import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { api, type Problem } from "../ui/api";
import { Dialog } from "../ui/dialog";

const EXAMPLES: readonly (readonly [source: string, words: string])[] = [
  ["/dev/ttyUSB0", "a serial port, its baud rate found by listening"],
  ["serial:///dev/ttyUSB0?baud=921600", "a serial port at a known rate"],
  ["tcp://192.168.1.20:2000", "a serial server or a device on the network"],
  ["tcp-listen://:2000", "wait for a device to connect"],
  ["udp://:34555", "datagrams to a port"],
  ["twin:xbus", "a simulated MTi, to try things out"],
];

interface Props {
  readonly onClose: () => void;
  /** Called with the id of the new device. */
  readonly onAdded: (id: string | undefined) => void;
}

const source = signal("");
const busy = signal(false);
const problem = signal<Problem | undefined>(undefined);

export function AddDevice({ onClose, onAdded }: Props) {
  const field = useRef<HTMLInputElement>(null);
  useEffect(() => {
    problem.value = undefined;
    field.current?.focus();
  }, []);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    const address = source.value.trim();
    if (address === "" || busy.value) return;
    busy.value = true;
    const outcome = await api.addDevice(address);
    busy.value = false;
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok) {
      field.current?.focus();
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
    <Dialog title="Add a device" onClose={onClose}>
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
            spellcheck={false}
            autocomplete="off"
            autocapitalize="off"
            aria-describedby={problem.value ? "source-problem" : "source-examples"}
            aria-invalid={problem.value !== undefined}
          />
        </div>
        {problem.value && <Wrong problem={problem.value} />}
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
        <div class="row">
          <button type="button" class="btn" onClick={onClose}>
            Cancel
          </button>
          <button type="submit" class="btn main" disabled={busy.value || source.value.trim() === ""}>
            {busy.value ? "Adding…" : "Add"}
          </button>
        </div>
      </form>
    </Dialog>
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
