/** The range of a plot beside the stack. Pure. */

/** Between both cursors if that was chosen and they are set, else the window; unix s. */
export function rangeOf(
  { range }: { readonly range?: "cursors" },
  a: number | undefined,
  b: number | undefined,
  right: number,
  span: number,
): readonly [t0: number, t1: number] {
  if (range === "cursors" && a !== undefined && b !== undefined) return [Math.min(a, b), Math.max(a, b)];
  return [right - span, right];
}
