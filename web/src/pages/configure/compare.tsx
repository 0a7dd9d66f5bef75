/** Two states side by side: device, snapshot, file, another device, factory; and writing one to the other. */
import { type Signal, signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Store } from "../../data/store";
import type { Difference, SideRef, SnapshotInfo } from "../../forms/types";
import { count } from "../../ui/format";
import { Icon } from "../../ui/icons";
import type { DeviceInfo } from "../../wire/types";
import { applied } from "./apply";
import { type Model, viewOnly } from "./model";
import { server } from "./server";
import { SnapshotActs } from "./snapshot";
import { goTo, here, question } from "./view";

/** A side as the menus name it: "device", "~factory", "~file", "~other:<id>", or a snapshot's name. */
const left = signal("device");
const file = signal<{ readonly name: string; readonly text: string } | undefined>(undefined);
const difference = signal<Difference | undefined>(undefined);
const why = signal("");
const targets = signal<ReadonlySet<string>>(new Set());

function refOf(side: string): SideRef {
  const blank = { snapshot: "", device: "", text: "" };
  if (side === "device" || side === "~factory") return { ...blank, side: side === "device" ? "device" : "factory" };
  if (side === "~file") return { ...blank, side: "text", text: file.value?.text ?? "" };
  if (side.startsWith("~other:")) return { ...blank, side: "other", device: side.slice("~other:".length) };
  return { ...blank, side: "snapshot", snapshot: side };
}

export function Compare({ model, store }: { readonly model: Model; readonly store: Store }) {
  const right = here.value.more ?? model.snapshots.value[0]?.name ?? "~factory";
  const taken = model.body.value?.info.taken;
  useEffect(() => {
    let stale = false;
    difference.value = undefined;
    why.value = "";
    if (right === "~file" && !file.value) why.value = "Choose a file: a snapshot as it was downloaded here or elsewhere.";
    else if ((left.value === "device" || right === "device") && !model.isRead.value) why.value = "The device was not read yet.";
    else {
      void server.compare(model.id, { left: refOf(left.value), right: refOf(right) }).then((answer) => {
        if (stale) return;
        if (answer.ok) difference.value = answer.value;
        else why.value = `${answer.problem.message} ${answer.problem.hint}`;
      });
    }
    return () => {
      stale = true;
    };
  }, [model, left.value, right, taken, file.value]);
  const others = store.devices.value.filter(({ id, protocol }) => id !== model.id && protocol === model.device.value?.protocol);
  return (
    <section class="setting compare" aria-label="Compare">
      <div class="sides">
        <SidePicker label="Left" model={model} others={others} side={left.value} choose={(side) => (left.value = side)} />
        <button type="button" class="btn icon" aria-label="Swap the sides" onClick={() => swap(model, right)}>
          <Icon name="left" />
        </button>
        <SidePicker label="Right" model={model} others={others} side={right} choose={(side) => goTo(model, "compare", side)} />
        <FilePicker model={model} />
      </div>
      {model.snapshots.value.some(({ name }) => name === right) && <SnapshotActs model={model} name={right} />}
      {why.value && <p class="hint inset">{why.value}</p>}
      {difference.value && <Table found={difference.value} />}
      {difference.value && left.value === "device" && <Adopt model={model} found={difference.value} others={others} />}
    </section>
  );
}

function swap(model: Model, right: string): void {
  const was = left.value;
  left.value = right;
  goTo(model, "compare", was);
}

interface PickerProps {
  readonly label: string;
  readonly model: Model;
  readonly others: readonly DeviceInfo[];
  readonly side: string;
  readonly choose: (side: string) => void;
}

function SidePicker({ label, model, others, side, choose }: PickerProps) {
  const stamp = (snapshot: SnapshotInfo): string => new Date(snapshot.taken * 1000).toISOString().slice(0, 16).replace("T", " ");
  return (
    <label class="select">
      <span class="vh">{label} side</span>
      <select aria-label={`${label} side`} value={side} onChange={(event) => choose(event.currentTarget.value)}>
        <option value="device">Device, as last read</option>
        <option value="~factory">Factory default</option>
        {model.snapshots.value.map((snapshot) => (
          <option key={snapshot.name} value={snapshot.name}>
            {snapshot.title} · {stamp(snapshot)}
          </option>
        ))}
        {others.map((device) => (
          <option key={device.id} value={`~other:${device.id}`}>
            {device.name} {device.serial_number}
          </option>
        ))}
        <option value="~file">{file.value ? `File ${file.value.name}` : "A file …"}</option>
      </select>
      <Icon name="down" />
    </label>
  );
}

const MOST_FILE = 1 << 20;

function FilePicker({ model }: { readonly model: Model }) {
  const take = async (chosen: File | undefined): Promise<void> => {
    if (!chosen) return;
    if (chosen.size > MOST_FILE) {
      why.value = "This file is too large for a snapshot.";
      return;
    }
    file.value = { name: chosen.name, text: await chosen.text() };
    goTo(model, "compare", "~file");
  };
  return (
    <label class="btn edge filepick">
      <input type="file" accept=".yaml,.yml,text/yaml" onChange={(event) => void take(event.currentTarget.files?.[0])} />
      Open a file
    </label>
  );
}

function Table({ found }: { readonly found: Difference }) {
  const missing = Object.entries(found.missing);
  return (
    <>
      <p class="mid inset" role="status">
        <b>{found.rows.length === 0 ? "No difference" : count(found.rows.length, "difference")}</b>, {count(found.same, "value")} agree.
      </p>
      {found.rows.length > 0 && (
        <div class="difftable">
          <table>
            <thead>
              <tr>
                <th>What</th>
                <th>{found.left}</th>
                <th>{found.right}</th>
              </tr>
            </thead>
            <tbody>
              {found.rows.map((row) => (
                <tr key={`${row.setting} ${row.path}`}>
                  <th scope="row">
                    {row.title} {!row.writable && <span class="tag">told by the device</span>}
                    <small class="dim mono">{row.setting}</small>
                  </th>
                  <td data-side={found.left}>{row.left || <span class="dim">not there</span>}</td>
                  <td data-side={found.right} class="right">
                    {row.right || <span class="dim">not there</span>}
                  </td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
      {missing.length > 0 && (
        <details class="inset">
          <summary>{count(missing.length, "setting")} could not be compared</summary>
          <ul class="dim">
            {missing.map(([name, reason]) => (
              <li key={name}>
                <span class="mono">{name}</span>: {reason}
              </li>
            ))}
          </ul>
        </details>
      )}
    </>
  );
}

interface AdoptProps {
  readonly model: Model;
  readonly found: Difference;
  readonly others: readonly DeviceInfo[];
}

/** Write the right side to the device, and to others of its kind. */
function Adopt({ model, found, others }: AdoptProps) {
  const settings = Object.keys(found.changes);
  if (settings.length === 0) return null;
  const cautions = settings.flatMap((name) => model.setting(name) ?? []).filter(({ caution }) => caution !== "");
  const act = async (): Promise<void> => {
    const devices = others.map(({ id }) => id).filter((id) => targets.value.has(id));
    const job = await model.run(server.apply(model.id, { changes: found.changes, reason: `Profile “${found.right}”`, confirmed: true, devices }));
    if (job) applied.value = { ...applied.value, [model.id]: job.id };
  };
  const ask = (): void => {
    if (cautions.length === 0) return void act();
    question.value = {
      title: `Write “${found.right}”?`,
      words: [...new Set(cautions.map(({ consequence, title }) => consequence || title))],
      caution: cautions[0]?.caution ?? "",
      go: "Write it",
      act: () => void act(),
    };
  };
  return (
    <div class="adopt">
      <Others others={others} />
      <button type="button" class="btn main" disabled={viewOnly.value} onClick={ask}>
        Apply this profile
      </button>
      <span class="dim">
        Writes {count(settings.length, "setting")} of “{found.right}”, reads them back and tells what came out otherwise.
      </span>
    </div>
  );
}

const toggled = (set: Signal<ReadonlySet<string>>, id: string): void => {
  const next = new Set(set.value);
  if (!next.delete(id)) next.add(id);
  set.value = next;
};

function Others({ others }: { readonly others: readonly DeviceInfo[] }) {
  if (others.length === 0) return null;
  return (
    <fieldset>
      <legend>Also to</legend>
      {others.map((device) => (
        <label key={device.id} class="flag">
          <input type="checkbox" class="check" checked={targets.value.has(device.id)} onChange={() => toggled(targets, device.id)} />
          <span>
            {device.name} <span class="mono dim">{device.serial_number}</span>
          </span>
        </label>
      ))}
    </fieldset>
  );
}
