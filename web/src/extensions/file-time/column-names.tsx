/** Names and units of the columns of a table, and which of them are read. */
import { type Signal, useSignal } from "@preact/signals";
import type { PreviewColumn, TablePreview } from "../../wire/routes";
import { choiceOf, type ColumnChoice, type Reading, withColumn } from "./reading";
import { TEXT } from "./texts";

interface Props {
  readonly table: TablePreview;
  readonly reading: Signal<Reading>;
}

export function ColumnNames({ table, reading }: Props) {
  const columns = table.columns.filter(({ role }) => role === "value" || role === "left out");
  return (
    <details class="table-columns">
      <summary>{TEXT.columnNames}</summary>
      <p class="dim">{TEXT.columnNamesHint}</p>
      <ul>
        {columns.map((column) => (
          <Column key={column.number} column={column} reading={reading} />
        ))}
      </ul>
    </details>
  );
}

function Column({ column, reading }: { readonly column: PreviewColumn; readonly reading: Signal<Reading> }) {
  const { number, heading } = column;
  const title = heading === "" ? TEXT.columnNumber(number) : heading;
  const own = useSignal(choiceOf(column)); // the preview follows later
  const choice = own.value;
  const set = (part: Partial<ColumnChoice>): void => {
    own.value = { ...own.peek(), ...part };
    reading.value = withColumn(reading.peek(), column, own.peek());
  };
  return (
    <li>
      <label class="flag">
        <input
          type="checkbox"
          class="check"
          checked={choice.isRead}
          onChange={(event) => set({ isRead: event.currentTarget.checked })}
        />
        <span>{title}</span>
      </label>
      <div class="field">
        <input
          type="text"
          aria-label={TEXT.nameOf(title)}
          value={choice.name}
          disabled={!choice.isRead}
          spellcheck={false}
          onChange={(event) => set({ name: event.currentTarget.value })}
        />
      </div>
      <div class="field unit-field">
        <input
          type="text"
          aria-label={TEXT.unitOf(title)}
          placeholder={TEXT.unit}
          value={choice.unit}
          disabled={!choice.isRead}
          spellcheck={false}
          onChange={(event) => set({ unit: event.currentTarget.value })}
        />
      </div>
    </li>
  );
}
