/**
 * Hex dump of bytes, eight to a line: offset, hex, characters. Pure.
 */
export const PER_LINE = 8;

/** A run of bytes of one line that changed together, or stayed. */
export interface Run {
  readonly text: string;
  readonly changed: boolean;
}

export interface HexLine {
  /** "0008" */
  readonly offset: string;
  /** The bytes, each followed by a space but the last; filled up to the width of a full line. */
  readonly bytes: readonly Run[];
  readonly letters: readonly Run[];
}

/** The bytes of a hex string, up to the first character that is not a hex digit. */
export function hexBytes(hex: string): Uint8Array {
  const digits = /^(?:[0-9a-f]{2})*/i.exec(hex)?.[0] ?? "";
  return Uint8Array.from({ length: digits.length / 2 }, (_, k) => parseInt(digits.slice(2 * k, 2 * k + 2), 16));
}

/** The lines of `bytes`; those that differ from `before` are marked. Without a `before` none are. */
export function hexLines(bytes: Uint8Array, before: Uint8Array | undefined): readonly HexLine[] {
  const changed = (k: number): boolean => before !== undefined && bytes[k] !== before[k];
  const lines: HexLine[] = [];
  for (let at = 0; at < bytes.length; at += PER_LINE) {
    const here = Array.from({ length: Math.min(PER_LINE, bytes.length - at) }, (_, k) => at + k);
    const pad = "   ".repeat(PER_LINE - here.length);
    const hex = runs(here, changed, (k) => `${(bytes[k] ?? 0).toString(16).toUpperCase().padStart(2, "0")} `);
    lines.push({
      offset: at.toString(16).toUpperCase().padStart(4, "0"),
      bytes: pad === "" ? hex : [...hex, { text: pad, changed: false }],
      letters: runs(here, changed, (k) => letter(bytes[k] ?? 0)),
    });
  }
  return lines;
}

function runs(
  places: readonly number[],
  changed: (k: number) => boolean,
  spell: (k: number) => string,
): readonly Run[] {
  const found: { text: string; changed: boolean }[] = [];
  for (const k of places) {
    const last = found.at(-1);
    if (last && last.changed === changed(k)) last.text += spell(k);
    else found.push({ text: spell(k), changed: changed(k) });
  }
  return found;
}

/** Printable ASCII unchanged, all else as a dot. */
function letter(byte: number): string {
  return byte >= 0x20 && byte < 0x7f ? String.fromCharCode(byte) : "·";
}
