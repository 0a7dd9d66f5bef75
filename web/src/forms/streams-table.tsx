/** The streams of an Inertial Sense device: which data sets come, how often, and what each costs the line. */
import { Icon } from "../ui/icons";
import { number } from "../ui/format";
import type { Sheet } from "./sheet";
import { paceWords, PERIODS, streamed, type StreamEntry, type StreamRow, streamRows } from "./streams";
import type { FieldForm, LoadInfo, StreamChoice } from "./types";
import { at, initialElement } from "./values";

interface Props {
  readonly sheet: Sheet;
  readonly field: FieldForm;
  readonly choices: readonly StreamChoice[];
  readonly load: LoadInfo | null;
  readonly hot: string;
}

export function StreamsTable({ sheet, field, choices, load, hot }: Props) {
  const path = [field.name];
  const entries = (at(sheet.values, path) ?? []) as readonly StreamEntry[];
  const before = sheet.before === undefined ? undefined : ((at(sheet.before, path) ?? []) as readonly StreamEntry[]);
  const rows = streamRows(choices, entries, before).filter((row) => sheet.all || row.choice?.simple !== false || row.place >= 0 || row.was !== "");
  const blank = initialElement(field) as StreamEntry;
  const set = (row: StreamRow) => (period: number | undefined) => sheet.set(path, streamed(entries, row, period, blank));
  return (
    <div class="outs streams">
      <table>
        <colgroup>
          {["check", "", "id", "rate", "load", "wasc"].map((name) => (
            <col class={name} key={name} />
          ))}
        </colgroup>
        <thead>
          <tr>
            <th>
              <span class="vh">On</span>
            </th>
            <th>Data set</th>
            <th>Id</th>
            <th>Rate</th>
            <th class="num">Load</th>
            <th>Changed</th>
          </tr>
        </thead>
        <tbody>
          {rows.map((row) => (
            <Row
              key={row.key}
              row={row}
              sheet={sheet}
              list={field.name}
              hot={row.place >= 0 && hot === `${field.name}.${row.place}`}
              bytes={row.place < 0 ? undefined : load?.parts.find((part) => part.path === `${field.name}.${row.place}`)?.bytes_per_s}
              set={set(row)}
            />
          ))}
        </tbody>
      </table>
    </div>
  );
}

interface RowProps {
  readonly row: StreamRow;
  readonly sheet: Sheet;
  readonly list: string;
  readonly hot: boolean;
  readonly bytes: number | undefined;
  readonly set: (period: number | undefined) => void;
}

function Row({ row, sheet, list, hot, bytes, set }: RowProps) {
  const on = row.place >= 0;
  const path = on ? `${list}.${row.place}` : "";
  const periods = [...new Set([...PERIODS, row.period])].sort((a, b) => a - b);
  const hover = { onPointerEnter: () => sheet.hover(path), onPointerLeave: () => sheet.hover(""), onFocusCapture: () => sheet.hover(path) };
  return (
    <tr class={`${on ? "" : "off"} ${row.was ? "ch" : ""} ${hot ? "hot" : ""}`} data-id={row.did} {...hover}>
      <td>
        <input type="checkbox" class="check" aria-label={row.title} checked={on} disabled={sheet.readOnly} onChange={() => set(on ? undefined : row.period)} />
      </td>
      <td class="ell" title={row.choice?.doc || row.choice?.name}>
        {row.title} <small class="dim">{row.choice?.group}</small>
      </td>
      <td class="mono dim">{row.did}</td>
      <td>
        <span class={`select ${on && row.was ? "ed" : ""}`}>
          <select aria-label={`Rate of ${row.title}`} value={on ? String(row.period) : ""} disabled={sheet.readOnly} onChange={(event) => set(Number(event.currentTarget.value))}>
            {!on && <option value="">off</option>}
            {periods.map((period) => (
              <option key={period} value={String(period)}>
                {paceWords(row.choice, period)}
              </option>
            ))}
          </select>
          <Icon name="down" />
        </span>
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
