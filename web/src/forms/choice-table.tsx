/** A table in which one chooses what a device sends: a row for each thing it has, what that costs the line, and what it was before. */
import type { ComponentChildren } from "preact";
import { number } from "../ui/format";
import { Icon } from "../ui/icons";
import type { Sheet } from "./form-context";
import type { LoadInfo } from "./types";

interface TableProps {
  /** Between "On" and "Load": class of the column and its heading. */
  readonly columns: readonly (readonly [name: string, heading: string])[];
  readonly kind?: string;
  readonly children: ComponentChildren;
}

export function ChoiceTable({ columns, kind = "", children }: TableProps) {
  return (
    <div class={`outs ${kind}`}>
      <table>
        <colgroup>
          {["check", ...columns.map(([name]) => name), "load", "wasc"].map((name) => (
            <col class={name} key={name} />
          ))}
        </colgroup>
        <thead>
          <tr>
            <th>
              <span class="vh">On</span>
            </th>
            {columns.map(([, heading]) => (
              <th key={heading}>{heading}</th>
            ))}
            <th class="num">Load</th>
            <th>Changed</th>
          </tr>
        </thead>
        <tbody>{children}</tbody>
      </table>
    </div>
  );
}

interface RowProps {
  readonly sheet: Sheet;
  /** The list whose element this row is, and its place there; −1: off. */
  readonly list: string;
  readonly place: number;
  readonly title: string;
  readonly was: string;
  readonly id: string | number;
  /** The path that the bytes beside the form point at. */
  readonly hot: string;
  readonly load: LoadInfo | null;
  /** There is no room for another. */
  readonly full?: boolean;
  readonly toggle: () => void;
  readonly children: ComponentChildren;
}

export function ChoiceRow({ sheet, list, place, title, was, id, hot, load, full = false, toggle, children }: RowProps) {
  const on = place >= 0;
  const path = on ? `${list}.${place}` : "";
  const bytes = on ? load?.parts.find((part) => part.path === path)?.bytes_per_s : undefined;
  const hover = { onPointerEnter: () => sheet.hover(path), onPointerLeave: () => sheet.hover(""), onFocusCapture: () => sheet.hover(path) };
  return (
    <tr class={`${on ? "" : "off"} ${was ? "ch" : ""} ${on && hot === path ? "hot" : ""}`} data-id={id} {...hover}>
      <td>
        <input type="checkbox" class="check" aria-label={title} checked={on} disabled={sheet.readOnly || (!on && full)} onChange={toggle} />
      </td>
      {children}
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
      <td class="wasc">{was && <span class="was">{was}</span>}</td>
    </tr>
  );
}

interface PickProps {
  readonly label: string;
  /** "" shows "off", for as long as it is. */
  readonly value: number | "";
  readonly options: readonly (readonly [value: number, words: string | undefined])[];
  readonly disabled: boolean;
  readonly edited?: boolean;
  readonly pick: (value: number) => void;
}

export function Pick({ label, value, options, disabled, edited = false, pick }: PickProps) {
  return (
    <span class={`select ${edited ? "ed" : ""}`}>
      <select aria-label={label} value={String(value)} disabled={disabled} onChange={(event) => pick(Number(event.currentTarget.value))}>
        {value === "" && <option value="">off</option>}
        {options.map(([option, words]) => (
          <option key={option} value={String(option)}>
            {words}
          </option>
        ))}
      </select>
      <Icon name="down" />
    </span>
  );
}
