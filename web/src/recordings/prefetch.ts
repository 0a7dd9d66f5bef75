/**
 * Prefetch of a recording before it is opened. A pointer rests on its name briefly before it presses, and a press lasts a tenth of a
 * second: the page's first requests are sent then.
 *
 *     pointer, focus on a name ──▶ prepare ──▶ GET …/<id> ──▶ VisibleRange ──▶ GET …/window      (of one recording, the last)
 *     the page of the recording ──▶ take ──▶ the same answers, there or under way
 *
 * Only recordings opened before are prefetched: the first opening decodes, which the user has not requested yet. The library's entry
 * must be unchanged when it is opened.
 */
import type { Outcome } from "../requests/http";
import { heardIn } from "./library-filter";
import { VisibleRange } from "./visible-range";
import { isOpening, recordingsApi } from "./api";
import type { OpeningState, RecordingDetail, RecordingInfo } from "../wire/recording-types";

/** A pointer passing over a list rests for less than this, ms. */
const REST_MS = 40;
/** Older prefetched data is requested again, ms. */
const KEPT_MS = 30_000;

export interface Answer {
  readonly outcome: Outcome<RecordingDetail | OpeningState>;
  /** Its samples, loaded or on their way; undefined if it is not decoded. */
  readonly screen: VisibleRange | undefined;
}

interface Prepared {
  readonly info: RecordingInfo;
  readonly since: number;
  readonly answer: Promise<Answer>;
}

/** Everything about a recording except its samples. */
export async function detailOf(id: string): Promise<Answer["outcome"]> {
  const outcome = await recordingsApi.detail(id);
  return outcome.ok && !isOpening(outcome.value) ? { ok: true, value: heardIn(outcome.value) } : outcome;
}

/** Request a recording; with `extraPlots` also all of its samples for these further plots, the initial view unless a link
 * gives another. */
async function begin(id: string, extraPlots?: ReadonlySet<string>): Promise<Answer> {
  const outcome = await detailOf(id);
  if (!outcome.ok || isOpening(outcome.value)) return { outcome, screen: undefined };
  const screen = new VisibleRange(outcome.value);
  if (extraPlots) screen.want(screen.whole(extraPlots));
  return { outcome, screen };
}

function isGood(one: Prepared | undefined, info: RecordingInfo): boolean {
  return one !== undefined && one.info === info && performance.now() - one.since < KEPT_MS;
}

/** The prefetched recording of a page: one at a time. */
export class Prefetch {
  #prepared: Prepared | undefined;
  #resting: ReturnType<typeof setTimeout> | undefined;

  /** Prefetch it. `now`: the pointer is already pressing. */
  prepare(info: RecordingInfo, extraPlots: ReadonlySet<string>, now = false): void {
    clearTimeout(this.#resting);
    if (!info.opened || info.recording || isGood(this.#prepared, info)) return;
    const start = (): void => {
      this.#drop();
      this.#prepared = { info, since: performance.now(), answer: begin(info.id, extraPlots) };
    };
    if (now) start();
    else this.#resting = setTimeout(start, REST_MS);
  }

  /** The pointer left. */
  pass(): void {
    clearTimeout(this.#resting);
  }

  /** The prefetched data of a recording, once; `info`: its present library entry. */
  take(id: string, info: RecordingInfo | undefined): Promise<Answer> {
    clearTimeout(this.#resting);
    const found = this.#prepared;
    if (found && info && found.info.id === id && isGood(found, info)) {
      this.#prepared = undefined;
      return found.answer;
    }
    this.#drop();
    return begin(id);
  }

  #drop(): void {
    void this.#prepared?.answer.then(({ screen }) => screen?.dispose());
    this.#prepared = undefined;
  }
}
