/** The output configuration of an MTi: what is sent, how often, in which form, and what each costs the line. */
import { Icon } from "../ui/icons";
import { number } from "../ui/format";
import {
  baseOf, changed, type Entry, EVERY, FRAMES, frameOf, idWords, type OutputRow, outputRows, precisionOf, PRECISIONS, rateWords, toggled, withFrame, withPrecision,
} from "./outputs";
import type { Sheet } from "./sheet";
import type { FieldForm, LoadInfo, OutputChoice } from "./types";
import { at } from "./values";

interface Props {
  readonly sheet: Sheet;
  /** The list of entries. */
  readonly field: FieldForm;
  readonly choices: readonly OutputChoice[];
  readonly load: LoadInfo | null;
  readonly hot: string;
}

export function OutputsTable({ sheet, field, choices, load, hot }: Props) {
  const path = [field.name];
  const entries = (at(sheet.values, path) ?? []) as readonly Entry[];
  const before = sheet.before === undefined ? undefined : ((at(sheet.before, path) ?? []) as readonly Entry[]);
  const rows = outputRows(choices, entries, before).filter((row) => sheet.all || row.choice?.simple !== false || row.place >= 0 || row.was !== "");
  const full = field.most > 0 && entries.length >= field.most;
  return (
    <div class="outs">
      <table>
        <colgroup>
          {["check", "", "id", "rate", "precision", "frame", "load", "wasc"].map((name) => (
            <col class={name} key={name} />
          ))}
        </colgroup>
        <thead>
          <tr>
            <th>
              <span class="vh">On</span>
            </th>
            <th>Data</th>
            <th>Id</th>
            <th>Rate</th>
            <th>Precision</th>
            <th>Frame</th>
            <th class="num">Load</th>
            <th>Changed</th>
          </tr>
        </thead>
        <tbody>
          {rows.map((row) => (
            <Row key={row.key} row={row} sheet={sheet} full={full} bytes={bytesOf(load, field, row)} hot={row.place >= 0 && hot === `${field.name}.${row.place}`} list={field.name} set={(next) => sheet.set(path, next)} choices={choices} entries={entries} />
          ))}
        </tbody>
      </table>
    </div>
  );
}

function bytesOf(load: LoadInfo | null, field: FieldForm, row: OutputRow): number | undefined {
  return row.place < 0 ? undefined : load?.parts.find(({ path }) => path === `${field.name}.${row.place}`)?.bytes_per_s;
}

interface RowProps {
  readonly row: OutputRow;
  readonly sheet: Sheet;
  readonly full: boolean;
  readonly bytes: number | undefined;
  readonly hot: boolean;
  readonly list: string;
  readonly set: (next: readonly Entry[]) => void;
  readonly choices: readonly OutputChoice[];
  readonly entries: readonly Entry[];
}

function Row({ row, sheet, full, bytes, hot, list, set, choices, entries }: RowProps) {
  const on = row.place >= 0;
  const path = on ? `${list}.${row.place}` : "";
  const hover = { onPointerEnter: () => sheet.hover(path), onPointerLeave: () => sheet.hover(""), onFocusCapture: () => sheet.hover(path) };
  const change = (part: Partial<Entry>): void => set(changed(choices, entries, row, part));
  return (
    <tr class={`${on ? "" : "off"} ${row.was ? "ch" : ""} ${hot ? "hot" : ""}`} data-id={idWords(baseOf(row.id))} {...hover}>
      <td>
        <input
          type="checkbox"
          class="check"
          aria-label={row.title}
          checked={on}
          disabled={sheet.readOnly || (!on && full)}
          onChange={() => set(toggled(choices, entries, row))}
        />
      </td>
      <td class="ell" title={row.choice?.doc}>
        {row.title}
      </td>
      <td class="mono dim">{idWords(row.id)}</td>
      <td>
        <Rate row={row} on={on} disabled={sheet.readOnly} change={change} />
      </td>
      <td>
        <Precision row={row} on={on} disabled={sheet.readOnly} change={change} />
      </td>
      <td>
        <Frame row={row} on={on} disabled={sheet.readOnly} change={change} />
      </td>
      <td class="num">
        {bytes === undefined ? (
          <span class="dim">—</span>
        ) : (
          <>
            {number(bytes, 0)}
            <span class="u">B/s</span>
          </>
        )}
      </td>
      <td class="wasc">{row.was && <span class="was">{row.was}</span>}</td>
    </tr>
  );
}

interface CellProps {
  readonly row: OutputRow;
  readonly on: boolean;
  readonly disabled: boolean;
  readonly change: (part: Partial<Entry>) => void;
}

function Rate({ row, on, disabled, change }: CellProps) {
  const rates = row.choice?.rates ?? [];
  if (rates.length === 0) return <span class="fixed">{on ? rateWords(row.choice, row.rate) : "off"}</span>;
  const listed = rates.includes(row.rate);
  return (
    <span class={`select ${on && row.was ? "ed" : ""}`}>
      <select aria-label={`Rate of ${row.title}`} value={on ? String(row.rate) : ""} disabled={disabled} onChange={(event) => change({ output_frequency: Number(event.currentTarget.value) })}>
        {!on && <option value="">off</option>}
        {on && !listed && <option value={String(row.rate)}>{rateWords(row.choice, row.rate)}</option>}
        {rates.map((rate) => (
          <option key={rate} value={String(rate)}>
            {rate} Hz
          </option>
        ))}
        {row.rate !== EVERY && <option value={String(EVERY)}>{rateWords(row.choice, EVERY)}</option>}
      </select>
      <Icon name="down" />
    </span>
  );
}

function Precision({ row, on, disabled, change }: CellProps) {
  const formats = row.choice?.formats ?? [];
  if (formats.length === 0) return <span class="fixed dim">{on ? "fixed" : ""}</span>;
  return (
    <span class="select">
      <select
        aria-label={`Precision of ${row.title}`}
        value={String(precisionOf(row.id))}
        disabled={disabled || !on}
        onChange={(event) => change({ data_identifier: withPrecision(row.id, Number(event.currentTarget.value)) })}
      >
        {formats.map((bits) => (
          <option key={bits} value={String(bits)}>
            {PRECISIONS[bits]}
          </option>
        ))}
      </select>
      <Icon name="down" />
    </span>
  );
}

function Frame({ row, on, disabled, change }: CellProps) {
  const frames = row.choice?.frames ?? [];
  if (frames.length === 0) return null;
  return (
    <span class="select">
      <select
        aria-label={`Frame of ${row.title}`}
        value={String(frameOf(row.id))}
        disabled={disabled || !on}
        onChange={(event) => change({ data_identifier: withFrame(row.id, Number(event.currentTarget.value)) })}
      >
        {frames.map((bits) => (
          <option key={bits} value={String(bits)}>
            {FRAMES[bits]}
          </option>
        ))}
      </select>
      <Icon name="down" />
    </span>
  );
}
