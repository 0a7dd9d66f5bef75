/** The outputs of a device as a table: which, at what rate, in which variant, and their load on the line. */
import { Select } from "../ui/controls/choices";
import type { FormContext } from "./form-context";
import {
  baseOf,
  variantBits,
  bitsWords,
  changed,
  type Entry,
  idWords,
  offeredRates,
  rateWords,
  type TableRow,
  tableRows,
  toggled,
  withVariantBits,
} from "./rate-table";
import type { FieldForm, KeyVariant, LoadInfo, RateTable } from "../wire/form-types";
import { at, initialElement } from "./values";
import { TEXT } from "../texts/forms";
import type { ComponentChildren } from "preact";
import { number } from "../ui/format/format";

interface Props {
  readonly sheet: FormContext;
  /** The list of entries. */
  readonly field: FieldForm;
  readonly table: RateTable;
  readonly load: LoadInfo | null;
  readonly hot: string;
}

export function RateTableEditor({ sheet, field, table, load, hot }: Props) {
  const path = [field.name];
  const entries = (at(sheet.values, path) ?? []) as readonly Entry[];
  const before = sheet.before === undefined ? undefined : ((at(sheet.before, path) ?? []) as readonly Entry[]);
  const idOf = (row: TableRow): string => idWords(table, baseOf(table, row.id));
  const rows = tableRows(table, entries, before).filter(
    (row) =>
      sheet.all ||
      row.choice?.basic !== false ||
      idOf(row).toLowerCase() === sheet.sought ||
      row.place >= 0 ||
      row.was !== "",
  );
  const full = field.max_length > 0 && entries.length >= field.max_length;
  const blank = initialElement(field) as Entry;
  const set = (next: readonly Entry[]): void => sheet.set(path, next);
  const columns: readonly (readonly [string, string])[] = [
    ["", table.heading],
    ["id", TEXT.id],
    ["rate", TEXT.rate],
    ...table.variants.map(({ name, title }) => [name, title] as const),
  ];
  return (
    <ChoiceTable columns={columns} kind={table.variants.length === 0 ? "without-variants" : ""}>
      {rows.map((row) => {
        const cell: CellProps = {
          table,
          row,
          disabled: sheet.readOnly,
          change: (part) => set(changed(table, entries, row, part, blank)),
        };
        const toggle = (): void => set(toggled(table, entries, row, blank));
        return (
          <ChoiceRow
            key={row.key}
            sheet={sheet}
            list={field.name}
            place={row.place}
            title={row.title}
            was={row.was}
            id={idOf(row)}
            hot={hot}
            load={load}
            full={full}
            toggle={toggle}
          >
            <td class="ellipsis" title={row.choice?.doc || row.choice?.name}>
              {row.title}
              {table.grouped && <small class="dim"> {row.choice?.group}</small>}
            </td>
            <td class="mono dim">{idWords(table, row.id)}</td>
            <td>
              <Rate {...cell} />
            </td>
            {table.variants.map((variant) => (
              <td key={variant.name}>
                <Variant {...cell} variant={variant} />
              </td>
            ))}
          </ChoiceRow>
        );
      })}
    </ChoiceTable>
  );
}

interface CellProps {
  readonly table: RateTable;
  readonly row: TableRow;
  readonly disabled: boolean;
  readonly change: (part: { readonly id?: number; readonly rate?: number }) => void;
}

function Rate({ table, row, disabled, change }: CellProps) {
  const on = row.place >= 0;
  const rates = offeredRates(table, row);
  if (rates.length === 0) return <span class="fixed">{on ? rateWords(table, row, row.rate) : TEXT.offInTable}</span>;
  return (
    <Select
      label={TEXT.rateOf(row.title)}
      class={on && row.was !== "" ? "edited" : ""}
      value={on ? row.rate : ""}
      none={TEXT.offInTable}
      options={rates.map((rate) => [rate, rateWords(table, row, rate)])}
      disabled={disabled}
      onChoose={(rate) => change({ rate })}
    />
  );
}

function Variant({ row, variant, disabled, change }: CellProps & { readonly variant: KeyVariant }) {
  const on = row.place >= 0;
  const available = row.choice?.variants[variant.name] ?? [];
  if (available.length === 0)
    return variant.fixed === "" ? null : <span class="fixed dim">{on ? variant.fixed : ""}</span>;
  return (
    <Select
      label={TEXT.variantOf(variant.title, row.title)}
      value={variantBits(variant, row.id)}
      options={available.map((bits) => [bits, bitsWords(variant, bits)])}
      disabled={disabled || !on}
      onChoose={(bits) => change({ id: withVariantBits(variant, row.id, bits) })}
    />
  );
}

interface TableProps {
  /** Between "On" and "Load": class of the column and its heading. */
  readonly columns: readonly (readonly [name: string, heading: string])[];
  readonly kind?: string;
  readonly children: ComponentChildren;
}

function ChoiceTable({ columns, kind = "", children }: TableProps) {
  return (
    <div class={`outputs ${kind}`}>
      <table>
        <colgroup>
          {["check", ...columns.map(([name]) => name), "load", "previous-column"].map((name) => (
            <col class={name} key={name} />
          ))}
        </colgroup>
        <thead>
          <tr>
            <th>
              <span class="visually-hidden">{TEXT.on}</span>
            </th>
            {columns.map(([, heading]) => (
              <th key={heading}>{heading}</th>
            ))}
            <th class="num">{TEXT.load}</th>
            <th>{TEXT.changed}</th>
          </tr>
        </thead>
        <tbody>{children}</tbody>
      </table>
    </div>
  );
}

interface RowProps {
  readonly sheet: FormContext;
  /** The list with this row's element, and its index; −1: off. */
  readonly list: string;
  readonly place: number;
  readonly title: string;
  readonly was: string;
  readonly id: string | number;
  /** The path highlighted by the bytes beside the form. */
  readonly hot: string;
  readonly load: LoadInfo | null;
  /** Whether the list is full. */
  readonly full?: boolean;
  readonly toggle: () => void;
  readonly children: ComponentChildren;
}

function ChoiceRow({ sheet, list, place, title, was, id, hot, load, full = false, toggle, children }: RowProps) {
  const on = place >= 0;
  const path = on ? `${list}.${place}` : "";
  const bytes = on ? load?.parts.find((part) => part.path === path)?.bytes_per_s : undefined;
  const hover = {
    onPointerEnter: () => sheet.hover(path),
    onPointerLeave: () => sheet.hover(""),
    onFocusCapture: () => sheet.hover(path),
  };
  return (
    <tr
      class={`${on ? "" : "off"} ${was ? "changed" : ""} ${on && hot === path ? "highlighted" : ""}`}
      data-id={id}
      {...hover}
    >
      <td>
        <input
          type="checkbox"
          class="check"
          aria-label={title}
          checked={on}
          disabled={sheet.readOnly || (!on && full)}
          onChange={toggle}
        />
      </td>
      {children}
      <td class="num">
        {bytes === undefined ? (
          <span class="dim">—</span>
        ) : (
          <>
            {number(bytes, 0)}
            <span class="unit">B/s</span>
          </>
        )}
      </td>
      <td class="previous-column ellipsis">{was && <span class="previous">{was}</span>}</td>
    </tr>
  );
}
