/** A table of selectable outputs of a device: a row for each, with its load on the line and its previous state. */
import type { ComponentChildren } from "preact";
import { number } from "../ui/format/format";
import type { FormContext } from "./form-context";
import type { LoadInfo } from "../wire/form-types";
import { TEXT } from "../texts/forms";

interface TableProps {
  /** Between "On" and "Load": class of the column and its heading. */
  readonly columns: readonly (readonly [name: string, heading: string])[];
  readonly kind?: string;
  readonly children: ComponentChildren;
}

export function ChoiceTable({ columns, kind = "", children }: TableProps) {
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

export function ChoiceRow({ sheet, list, place, title, was, id, hot, load, full = false, toggle, children }: RowProps) {
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
