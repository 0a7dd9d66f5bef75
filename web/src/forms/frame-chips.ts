/** A frame as chips: groups of bytes with their meaning, by field. Pure. */
import type { FrameInfo, ByteRange } from "../wire/form-types";

export interface Chip {
  readonly key: string;
  /** "40 20 01 90" */
  readonly bytes: string;
  readonly words: string;
  /** Their row: "outputs.3", "roll"; "" for the envelope. */
  readonly path: string;
}

/** A longer run of bytes is cut here; the copy has them all. */
const MAX_BYTES = 24;
const MAX_WORDS = 44;

/** The row of a path: an element of a list, else the field. Names of fields may contain dots. */
export function rowOf(path: string): string {
  return /^(.+?\.\d+)(?:\.|$)/.exec(path)?.[1] ?? path;
}

export function chipsOf(frame: FrameInfo): readonly Chip[] {
  const chips: { spans: ByteRange[]; path: string }[] = [];
  for (const span of frame.spans) {
    const path = rowOf(span.path);
    const last = chips.at(-1);
    if (last && path !== "" && last.path === path) last.spans.push(span);
    else chips.push({ spans: [span], path });
  }
  return chips.map(({ spans, path }, k) => {
    const [first] = spans;
    const [begin, size] = [first?.offset ?? 0, spans.reduce((sum, span) => sum + span.size, 0)];
    return {
      key: `${k}`,
      bytes: spaced(frame.hex.slice(2 * begin, 2 * (begin + size)), MAX_BYTES),
      words: cut(spans.map(brief).join(" · ")),
      path,
    };
  });
}

/** "FAFF30" → "FA FF 30", with an ellipsis after `most` bytes. */
export function spaced(hex: string, most = Infinity): string {
  const pairs = hex.toUpperCase().match(/../g) ?? [];
  return pairs.slice(0, most).join(" ") + (pairs.length > most ? " …" : "");
}

/** Label of a chip, without the name of the field that the row already shows. */
function brief({ label, path }: ByteRange): string {
  const name = path.split(".").at(-1) ?? "";
  const said =
    name !== "" && label.startsWith(name) ? label.slice(name.length).replace(/^\s*[:=]\s*/, "") || label : label;
  return path.includes(".") ? said.replace(/^with every message.*/, "every") : label;
}

const cut = (text: string): string => (text.length > MAX_WORDS ? `${text.slice(0, MAX_WORDS - 1)}…` : text);

/** Full text of a chip, for the line under the bytes. */
export function spelled(frame: FrameInfo, path: string): readonly { readonly bytes: string; readonly words: string }[] {
  return frame.spans
    .filter((span) => span.path !== "" && rowOf(span.path) === path)
    .map(({ offset, size, label }) => ({
      bytes: spaced(frame.hex.slice(2 * offset, 2 * (offset + size)), MAX_BYTES),
      words: label,
    }));
}
