/**
 * Roles of the list's parts. It is a grid made of plain elements, because a table cannot leave out the rows that are out of view; the
 * focus stays on the grid, which names the active row and handles its keys.
 */
import type { HTMLAttributes } from "preact";
import { TEXT } from "./texts";

export const ROLES = {
  rows: { role: "rowgroup" },
  head: { role: "row", "aria-rowindex": 1 },
  cell: { role: "gridcell" },
} as const;

type Properties = HTMLAttributes<HTMLDivElement>;

export function gridProperties(
  lines: number,
  active: string | undefined,
  handlers: Pick<Properties, "onScroll" | "onKeyDown">,
): Properties {
  return {
    role: "grid",
    tabIndex: 0,
    "aria-label": TEXT.robots,
    "aria-rowcount": lines + 1,
    ...(active === undefined ? {} : { "aria-activedescendant": active }),
    ...handlers,
  };
}

export function mapProperties(
  active: string | undefined,
  handlers: Pick<Properties, "onKeyDown" | "onClick" | "onPointerOver" | "onPointerLeave">,
): Properties {
  return {
    role: "listbox",
    tabIndex: 0,
    "aria-label": TEXT.robots,
    ...(active === undefined ? {} : { "aria-activedescendant": active }),
    ...handlers,
  };
}

export function groupProperties(label: string): Properties {
  return label === "" ? { role: "presentation" } : { role: "group", "aria-label": label };
}

export function cellProperties(id: string, label: string, isOpen: boolean): HTMLAttributes<HTMLSpanElement> {
  return { role: "option", id, "aria-label": label, "aria-selected": isOpen };
}

interface RowPlace {
  readonly id: string;
  /** From 0; the head of the columns is the first row of the grid. */
  readonly index: number;
  /** px from the top of the list. */
  readonly top: number;
}

export function rowProperties(
  { id, index, top }: RowPlace,
  state: { readonly "aria-selected"?: boolean; readonly "aria-expanded"?: boolean },
  onClick: (event: MouseEvent) => void,
): Properties {
  return {
    role: "row",
    id,
    "aria-rowindex": index + 2,
    style: { transform: `translateY(${top}px)` },
    onClick,
    ...state,
  };
}

export function columnProperties(order: "ascending" | "descending" | "none"): HTMLAttributes<HTMLSpanElement> {
  return { role: "columnheader", "aria-sort": order };
}
