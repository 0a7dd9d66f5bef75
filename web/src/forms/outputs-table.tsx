/** The output configuration of an MTi: outputs, rates, formats, and their load on the line. */
import { ChoiceRow, ChoiceTable, Pick } from "./choice-table";
import {
  baseOf,
  changed,
  type Entry,
  EVERY,
  FRAMES,
  frameOf,
  idWords,
  type OutputRow,
  outputRows,
  precisionOf,
  PRECISIONS,
  rateWords,
  toggled,
  withFrame,
  withPrecision,
} from "./outputs";
import type { FormContext } from "./form-context";
import type { FieldForm, LoadInfo, OutputChoice } from "./types";
import { at } from "./values";
import { TEXT } from "../texts/forms";

const COLUMNS = [
  ["", TEXT.data],
  ["id", TEXT.id],
  ["rate", TEXT.rate],
  ["precision", TEXT.precision],
  ["frame", TEXT.frame],
] as const;

interface Props {
  readonly sheet: FormContext;
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
  const rows = outputRows(choices, entries, before).filter(
    (row) =>
      sheet.all ||
      row.choice?.basic !== false ||
      idWords(baseOf(row.id)).toLowerCase() === sheet.sought ||
      row.place >= 0 ||
      row.was !== "",
  );
  const full = field.max_length > 0 && entries.length >= field.max_length;
  const set = (next: readonly Entry[]): void => sheet.set(path, next);
  return (
    <ChoiceTable columns={COLUMNS}>
      {rows.map((row) => {
        const cell: CellProps = {
          row,
          on: row.place >= 0,
          disabled: sheet.readOnly,
          change: (part) => set(changed(choices, entries, row, part)),
        };
        const toggle = (): void => set(toggled(choices, entries, row));
        return (
          <ChoiceRow
            key={row.key}
            sheet={sheet}
            list={field.name}
            place={row.place}
            title={row.title}
            was={row.was}
            id={idWords(baseOf(row.id))}
            hot={hot}
            load={load}
            full={full}
            toggle={toggle}
          >
            <td class="ellipsis" title={row.choice?.doc}>
              {row.title}
            </td>
            <td class="mono dim">{idWords(row.id)}</td>
            <td>
              <Rate {...cell} />
            </td>
            <td>
              <Precision {...cell} />
            </td>
            <td>
              <Frame {...cell} />
            </td>
          </ChoiceRow>
        );
      })}
    </ChoiceTable>
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
  if (rates.length === 0) return <span class="fixed">{on ? rateWords(row.choice, row.rate) : TEXT.offInTable}</span>;
  const offered = [
    ...(on && !rates.includes(row.rate) ? [row.rate] : []),
    ...rates,
    ...(row.rate === EVERY ? [] : [EVERY]),
  ];
  const options = offered.map((rate) => [rate, rateWords(row.choice, rate)] as const);
  return (
    <Pick
      label={TEXT.rateOf(row.title)}
      value={on ? row.rate : ""}
      options={options}
      disabled={disabled}
      edited={on && row.was !== ""}
      pick={(rate) => change({ output_frequency: rate })}
    />
  );
}

function Precision({ row, on, disabled, change }: CellProps) {
  const formats = row.choice?.formats ?? [];
  if (formats.length === 0) return <span class="fixed dim">{on ? TEXT.fixed : ""}</span>;
  const options = formats.map((bits) => [bits, PRECISIONS[bits]] as const);
  return (
    <Pick
      label={TEXT.precisionOf(row.title)}
      value={precisionOf(row.id)}
      options={options}
      disabled={disabled || !on}
      pick={(bits) => change({ data_identifier: withPrecision(row.id, bits) })}
    />
  );
}

function Frame({ row, on, disabled, change }: CellProps) {
  const frames = row.choice?.frames ?? [];
  if (frames.length === 0) return null;
  const options = frames.map((bits) => [bits, FRAMES[bits]] as const);
  return (
    <Pick
      label={TEXT.frameOf(row.title)}
      value={frameOf(row.id)}
      options={options}
      disabled={disabled || !on}
      pick={(bits) => change({ data_identifier: withFrame(row.id, bits) })}
    />
  );
}
