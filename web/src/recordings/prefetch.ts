/**
 * Can a recording be there before it is opened? A pointer rests on its name for a moment before it presses, and a press lasts a
 * tenth of a second before it is one: what the page will ask for first is asked for then.
 *
 *     pointer, focus on a name ──▶ prepare ──▶ GET …/<id> ──▶ Screen ──▶ GET …/window      (of one recording, the last)
 *     the page of the recording ──▶ take ──▶ the same answers, there or under way
 *
 * Only what was opened before is prepared: the first time a recording is decoded, which nobody has asked for yet. What the library says
 * of it must still be the same when it is opened.
 */
import type { Outcome } from "../ui/http";
import { heardIn } from "./library-filter";
import { Screen } from "./visible-range";
import { isOpening, server } from "./api";
import type { OpeningState, RecordingDetail, RecordingInfo } from "./types";

/** A pointer that only passes over a list rests nowhere so long, ms. */
const REST_MS = 40;
/** What was prepared longer ago is asked for anew, ms. */
const KEPT_MS = 30_000;

export interface Answer {
  readonly outcome: Outcome<RecordingDetail | OpeningState>;
  /** Its samples, there or under way; undefined where it is not decoded. */
  readonly screen: Screen | undefined;
}

interface Prepared {
  readonly info: RecordingInfo;
  readonly since: number;
  readonly answer: Promise<Answer>;
}

let prepared: Prepared | undefined;
let resting: ReturnType<typeof setTimeout> | undefined;

/** Everything about a recording but its samples. */
export async function detailOf(id: string): Promise<Answer["outcome"]> {
  const outcome = await server.detail(id);
  return outcome.ok && !isOpening(outcome.value) ? { ok: true, value: heardIn(outcome.value) } : outcome;
}

/** Ask for a recording; `whole`: and as soon as it is known for all of it, which is seen first where no link says otherwise. */
async function begin(id: string, whole: boolean): Promise<Answer> {
  const outcome = await detailOf(id);
  if (!outcome.ok || isOpening(outcome.value)) return { outcome, screen: undefined };
  const screen = new Screen(outcome.value);
  if (whole) screen.want(screen.whole());
  return { outcome, screen };
}

/** Somebody is about to open it. `now`: is pressing already. */
export function prepare(info: RecordingInfo, now = false): void {
  clearTimeout(resting);
  if (!info.opened || info.recording || isGood(prepared, info)) return;
  const start = (): void => {
    drop();
    prepared = { info, since: performance.now(), answer: begin(info.id, true) };
  };
  if (now) start();
  else resting = setTimeout(start, REST_MS);
}

/** The pointer went on. */
export function pass(): void {
  clearTimeout(resting);
}

/** What was prepared of a recording, once; `info`: as the library tells it now. */
export function take(id: string, info: RecordingInfo | undefined): Promise<Answer> {
  clearTimeout(resting);
  const found = prepared;
  if (found && info && found.info.id === id && isGood(found, info)) {
    prepared = undefined;
    return found.answer;
  }
  drop();
  return begin(id, false);
}

function isGood(one: Prepared | undefined, info: RecordingInfo): boolean {
  return one !== undefined && one.info === info && performance.now() - one.since < KEPT_MS;
}

function drop(): void {
  void prepared?.answer.then(({ screen }) => screen?.dispose());
  prepared = undefined;
}
