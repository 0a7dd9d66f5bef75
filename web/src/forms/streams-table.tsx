/** The streams of an Inertial Sense device: data sets, periods, and their load on the line. */
import { ChoiceRow, ChoiceTable, Pick } from "./choice-table";
import type { FormContext } from "./form-context";
import { paceWords, PERIODS, streamed, type StreamEntry, type StreamRow, streamRows } from "./streams";
import type { FieldForm, LoadInfo, StreamChoice } from "./types";
import { at, initialElement } from "./values";
import { TEXT } from "../texts/forms";

const COLUMNS = [
  ["", TEXT.dataSet],
  ["id", TEXT.id],
  ["rate", TEXT.rate],
] as const;

interface Props {
  readonly sheet: FormContext;
  readonly field: FieldForm;
  readonly choices: readonly StreamChoice[];
  readonly load: LoadInfo | null;
  readonly hot: string;
}

export function StreamsTable({ sheet, field, choices, load, hot }: Props) {
  const path = [field.name];
  const entries = (at(sheet.values, path) ?? []) as readonly StreamEntry[];
  const before = sheet.before === undefined ? undefined : ((at(sheet.before, path) ?? []) as readonly StreamEntry[]);
  const rows = streamRows(choices, entries, before).filter(
    (row) =>
      sheet.all || row.choice?.basic !== false || String(row.did) === sheet.sought || row.place >= 0 || row.was !== "",
  );
  const blank = initialElement(field) as StreamEntry;
  const set = (row: StreamRow, period: number | undefined): void =>
    sheet.set(path, streamed(entries, row, period, blank));
  return (
    <ChoiceTable columns={COLUMNS} kind="streams">
      {rows.map((row) => {
        const on = row.place >= 0;
        const toggle = (): void => set(row, on ? undefined : row.period);
        return (
          <ChoiceRow
            key={row.key}
            sheet={sheet}
            list={field.name}
            place={row.place}
            title={row.title}
            was={row.was}
            id={row.did}
            hot={hot}
            load={load}
            toggle={toggle}
          >
            <td class="ellipsis" title={row.choice?.doc || row.choice?.name}>
              {row.title} <small class="dim">{row.choice?.group}</small>
            </td>
            <td class="mono dim">{row.did}</td>
            <td>
              <Pace row={row} on={on} disabled={sheet.readOnly} pick={(period) => set(row, period)} />
            </td>
          </ChoiceRow>
        );
      })}
    </ChoiceTable>
  );
}

function Pace({
  row,
  on,
  disabled,
  pick,
}: {
  readonly row: StreamRow;
  readonly on: boolean;
  readonly disabled: boolean;
  readonly pick: (period: number) => void;
}) {
  const periods = [...new Set([...PERIODS, row.period])].sort((a, b) => a - b);
  const options = periods.map((period) => [period, paceWords(row.choice, period)] as const);
  return (
    <Pick
      label={TEXT.rateOf(row.title)}
      value={on ? row.period : ""}
      options={options}
      disabled={disabled}
      edited={on && row.was !== ""}
      pick={pick}
    />
  );
}
