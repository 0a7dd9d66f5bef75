/**
 * Times in a text: `[14:32:18.500]`, a range `[14:32:18 – 14:32:20.5]`, with the day `[2026-11-21 14:32:18]` where a recording lasts
 * longer than one. In UTC, as everywhere on the page. Pure; server/extensions/evidence/note_times.py reads the same.
 */
import { clock } from "../../ui/format/format";

export interface Piece {
  readonly text: string;
  /** Unix s; a moment has no t1. */
  readonly t0?: number;
  readonly t1?: number;
}

const CLOCK = String.raw`(?:(\d{4}-\d\d-\d\d) )?(\d\d):(\d\d):(\d\d(?:\.\d{1,7})?)`;
const TIMES = new RegExp(String.raw`\[${CLOCK}(?:\s*[–-]\s*${CLOCK})?\]`, "g");
const DAY_S = 86_400;

/** The moment of a clock; without a day the first one from `from` on. */
function momentOf([day, hours, minutes, seconds]: readonly (string | undefined)[], from: number): number {
  const time = 3600 * Number(hours) + 60 * Number(minutes) + Number(seconds);
  if (day !== undefined) return Date.parse(`${day}T00:00:00Z`) / 1000 + time;
  const midnight = Math.floor(from / DAY_S) * DAY_S;
  return midnight + time + (midnight + time < from ? DAY_S : 0);
}

/** The text in pieces; `first` is the beginning of the recording, unix s. */
export function piecesOf(text: string, first: number): readonly Piece[] {
  const pieces: Piece[] = [];
  let at = 0;
  for (const found of text.matchAll(TIMES)) {
    // a time without its fraction may lie just before the beginning
    const t0 = momentOf(found.slice(1, 5), Math.floor(first));
    const t1 = found[6] === undefined ? undefined : momentOf(found.slice(5, 9), t0);
    if (found.index > at) pieces.push({ text: text.slice(at, found.index) });
    pieces.push({ text: found[0].slice(1, -1), t0, ...(t1 === undefined ? {} : { t1 }) });
    at = found.index + found[0].length;
  }
  if (at < text.length) pieces.push({ text: text.slice(at) });
  return pieces;
}

/** A moment or a range as text; with the day where `span` is longer than one. */
export function timeText(t0: number, t1: number | undefined, span: number): string {
  const word = (t: number): string =>
    span < DAY_S ? clock(t, 3) : `${new Date(t * 1000).toISOString().slice(0, 10)} ${clock(t, 3)}`;
  return t1 === undefined ? `[${word(t0)}]` : `[${word(Math.min(t0, t1))} – ${word(Math.max(t0, t1))}]`;
}
