/**
 * Properties of a line of the list. It is a grid made of plain elements, because a table cannot leave out the rows that are out of view; the
 * focus stays on the grid, which names the active row and handles its keys.
 */
import type { HTMLAttributes } from "preact";

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
): HTMLAttributes<HTMLDivElement> {
  return {
    role: "row",
    id,
    "aria-rowindex": index + 2,
    style: { transform: `translateY(${top}px)` },
    onClick,
    ...state,
  };
}
