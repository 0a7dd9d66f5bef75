/** Two states side by side: device, snapshot, file, another device, factory; and writing one to devices. */
import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Store } from "../../data/store";
import type { Difference, DifferenceRow } from "../../wire/form-types";
import { IconButton } from "../../ui/controls/icon-button";
import { Select } from "../../ui/controls/choices";
import { Message } from "../../ui/controls/message";
import { fullName } from "../../wire/device-name";
import type { DeviceInfo } from "../../wire/types";
import { route } from "../../page/route";
import type { Model } from "./model";
import { Slot } from "../../extension/extension";
import { configureApi } from "./api";
import { Answered, useAnswer } from "../../requests/use-answer";
import { sideRef, type SideName, snapshotTitle } from "./sides";
import { SnapshotActs } from "./snapshot";
import { goTo } from "./view-state";
import { TableHead } from "../../ui/controls/table-head";
import { isViewOnly } from "../../wire/capabilities";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";

declare module "../../extension/extension" {
  interface Slots {
    /** Under the comparison of two states of a device. */
    readonly comparisonActions: ComparisonActionProps;
  }
}

/** The differences to write, by their keys, as far as they were chosen. */
export type Take = Readonly<Record<string, boolean>>;
const BY_DEFAULT: Take = {};

export interface ComparisonActionProps {
  readonly model: Model;
  readonly store: Store;
  /** The other devices of the same protocol. */
  readonly others: readonly DeviceInfo[];
  readonly side: SideName;
  /** The differences to write, of each device. */
  readonly take: Take;
  readonly title: string;
}

export function Compare({ model, store }: { readonly model: Model; readonly store: Store }) {
  /** Why a file was not taken. */
  const refused = useSignal("");
  const take = useSignal(BY_DEFAULT);
  const left = model.left.value;
  const right =
    route.value.more ?? model.snapshots.value[0]?.name ?? (model.forms.value?.factory ? "~factory" : "~file");
  const file = model.file.value;
  const taken = model.body.value?.info.taken;
  useEffect(() => {
    take.value = BY_DEFAULT;
    refused.value = "";
  }, [model, left, right, file]);
  const isUnread = (left === "device" || right === "device") && !model.isRead.value;
  const why = right === "~file" && !file ? TEXT.chooseFile : isUnread ? TEXT.deviceNotRead : refused.value;
  const sides = { left: sideRef(left, file?.text ?? ""), right: sideRef(right, file?.text ?? ""), take: take.value };
  const question = why ? "" : JSON.stringify([model.id, taken, model.loads.value, sides]);
  const difference = useAnswer(question, () => configureApi.compare(model.id, sides));
  const others = store.devices.value.filter(
    ({ id, protocol }) => id !== model.id && protocol === model.device.value?.protocol,
  );
  return (
    <section class="setting compare" aria-label={TEXT.compare}>
      <div class="sides control-row">
        <SidePicker
          label={TEXT.left}
          model={model}
          others={others}
          side={left}
          choose={(side) => (model.left.value = side)}
        />
        <IconButton icon="left" label={TEXT.swapSides} onClick={() => swap(model, right)} />
        <SidePicker
          label={TEXT.right}
          model={model}
          others={others}
          side={right}
          choose={(side) => goTo(model, "compare", side)}
        />
        <FilePicker model={model} refuse={(words) => (refused.value = words)} />
      </div>
      {model.snapshots.value.some(({ name }) => name === right) && <SnapshotActs model={model} name={right} />}
      {why && (
        <p class="hint inset" role="status">
          <Message text={why} />
        </p>
      )}
      <Answered of={difference}>
        {(found) => (
          <>
            <Problems found={found} />
            <Table found={found} take={take} disabled={isViewOnly.value} />
            <Slot
              key={`${model.id} ${right} ${file?.name ?? ""}`}
              name="comparisonActions"
              with={{
                model,
                store,
                others,
                side: right,
                take: take.value,
                title: titleHere(model, right) ?? found.right,
              }}
            />
          </>
        )}
      </Answered>
    </section>
  );
}

const titleHere = (model: Model, side: SideName): string | undefined => {
  const snapshot = model.snapshots.value.find(({ name }) => name === side);
  return snapshot && snapshotTitle(snapshot);
};

/** Problems of the right side: misspelt, out of range. Shown before anything is written. */
function Problems({ found }: { readonly found: Difference }) {
  if (found.problems.length === 0) return null;
  return (
    <div class="inset problem" role="alert">
      <b>{TEXT.valuesCannotBeWritten(found.right, found.problems.length)}</b>
      <ul>
        {found.problems.map(({ path, message, hint }) => (
          <li key={path}>
            <span class="mono">{path}</span>: <Message text={message} /> <Message text={hint} />
          </li>
        ))}
      </ul>
    </div>
  );
}

function swap(model: Model, right: string): void {
  const was = model.left.value;
  model.left.value = right;
  goTo(model, "compare", was);
}

interface PickerProps {
  readonly label: string;
  readonly model: Model;
  readonly others: readonly DeviceInfo[];
  readonly side: SideName;
  readonly choose: (side: SideName) => void;
}

function SidePicker({ label, model, others, side, choose }: PickerProps) {
  const stamp = (taken: number): string => new Date(taken * 1000).toISOString().slice(0, 19).replace("T", " ");
  const file = model.file.value;
  return (
    <Select
      label={TEXT.side(label)}
      value={side}
      options={[
        ["device", TEXT.deviceAsLastRead],
        ...(model.forms.value?.factory || side === "~factory" ? [["~factory", TEXT.factoryDefault] as const] : []),
        ...model.snapshots.value.map(
          (snapshot) => [snapshot.name, `${snapshotTitle(snapshot)} · ${stamp(snapshot.taken)}`] as const,
        ),
        ...others.map((device) => [`~other:${device.id}`, fullName(device)] as const),
        ["~file", file ? TEXT.file(file.name) : TEXT.fileChoice],
      ]}
      onChoose={choose}
    />
  );
}

const MAX_FILE = 1 << 20;

function FilePicker({ model, refuse }: { readonly model: Model; readonly refuse: (words: string) => void }) {
  const take = async (chosen: File | undefined): Promise<void> => {
    if (!chosen) return;
    if (chosen.size > MAX_FILE) {
      refuse(TEXT.fileTooLarge);
      return;
    }
    model.file.value = { name: chosen.name, text: await chosen.text() };
    goTo(model, "compare", "~file");
  };
  return (
    <label class="btn edge file-picker">
      <input
        type="file"
        accept=".yaml,.yml,text/yaml"
        onChange={(event) => void take(event.currentTarget.files?.[0])}
      />
      {TEXT.openFile}
    </label>
  );
}

/** The title of a difference; one that can be written is ticked for it. */
function Tick({ row, take, disabled }: Omit<TableProps, "found"> & { readonly row: DifferenceRow }) {
  if (!row.writable)
    return (
      <>
        {row.title} {row.why ? <small class="why-not">{row.why}</small> : <span class="tag">{COMMON.readOnly}</span>}
      </>
    );
  return (
    <label class="tick">
      <input
        type="checkbox"
        class="check"
        checked={take.value[row.key] ?? row.take}
        disabled={disabled}
        onChange={({ currentTarget }) => (take.value = { ...take.value, [row.key]: currentTarget.checked })}
      />{" "}
      {row.title}
    </label>
  );
}

interface TableProps {
  readonly found: Difference;
  readonly take: Signal<Take>;
  readonly disabled: boolean;
}

function Table({ found, take, disabled }: TableProps) {
  const missing = Object.entries(found.missing);
  return (
    <>
      <p class="mid inset" role="status">
        <b>{found.rows.length === 0 ? TEXT.noDifference : TEXT.differenceCount(found.rows.length)}</b>
        {TEXT.valuesAgree(found.same)}
      </p>
      {found.rows.length > 0 && (
        <div class="difference-table">
          <table>
            <TableHead of={[TEXT.setting, found.left, found.right]} />
            <tbody>
              {found.rows.map((row) => (
                <tr key={`${row.setting} ${row.path}`}>
                  <th scope="row">
                    <Tick row={row} take={take} disabled={disabled} />
                    <small class="dim mono">{row.setting}</small>
                  </th>
                  <td data-side={found.left}>{row.left || <span class="dim">{TEXT.missing}</span>}</td>
                  <td data-side={found.right} class="right">
                    {row.right || <span class="dim">{TEXT.missing}</span>}
                  </td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
      {missing.length > 0 && (
        <details class="inset">
          <summary>{TEXT.settingsNotCompared(missing.length)}</summary>
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
