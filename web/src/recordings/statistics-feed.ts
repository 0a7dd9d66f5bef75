/**
 * Statistics of a window whose samples the page holds only summarised. The server counts them all (recordings/columns/statistics.py); one
 * answer is held, for all channels of the selected device, and is valid for windows that hardly differ from its own.
 */
import { type MatrixRow, inFrame } from "../data/frames";
import type { Stats } from "../data/statistics";
import type { TimeBase } from "../data/view";
import type { ColumnStatistics } from "../wire/routes";
import { fetchStatistics } from "./api";

export interface StatisticsRequest {
  readonly channels: readonly number[];
  readonly from: number;
  readonly to: number;
  readonly base: TimeBase;
}

/** A window that moved or grew by no more than this fraction of its length is not requested again: its statistics look the same. */
const UNMOVED = 0.002;
const ALIKE_SHARE = 0.05;
/** A window is requested after it has stood still for this long, ms; a moving one, this often. */
const REST_MS = 120;
const MOVING_MS = 500;
/** Counting hours takes the server a moment: the next request waits this many times the last answer's duration. */
const PAUSE_FACTOR = 3;
const PATIENCE_MS = 3000;

function same(a: StatisticsRequest, b: StatisticsRequest, part: number): boolean {
  const slack = part * (b.to - b.from);
  const channels = a.channels.length === b.channels.length && a.channels.every((id, k) => id === b.channels[k]);
  return channels && a.base === b.base && Math.abs(a.from - b.from) <= slack && Math.abs(a.to - b.to) <= slack;
}

const finite = (value: number | null): number => value ?? NaN;

export class StatisticsFeed {
  readonly #stop = new AbortController();
  #held:
    | { readonly of: StatisticsRequest; readonly columns: Readonly<Record<string, readonly ColumnStatistics[]>> }
    | undefined;
  #request: StatisticsRequest | undefined;
  #since = 0;
  #began = -Infinity;
  #busy = false;
  #notBefore = -Infinity;

  /** @param fetch requests from the server; another one in tests */
  constructor(
    readonly recording: string,
    readonly fetch: typeof fetchStatistics = fetchStatistics,
    readonly clock: () => number = () => performance.now(),
  ) {}

  /** Request the statistics of a window; call it repeatedly. */
  want(request: StatisticsRequest): void {
    const now = this.clock();
    if (this.#request === undefined || !same(this.#request, request, UNMOVED)) this.#since = now;
    this.#request = request;
    if (request.channels.length === 0 || (this.#held !== undefined && same(this.#held.of, request, UNMOVED))) return;
    const isDue = now - this.#since >= REST_MS || now - this.#began >= MOVING_MS;
    if (!this.#busy && now >= this.#notBefore && isDue) void this.#ask(request);
  }

  /** Statistics of a column, if loaded for the requested window. */
  of(channel: number, column: number): Stats | undefined {
    if (this.#held === undefined || this.#request === undefined || !same(this.#held.of, this.#request, ALIKE_SHARE))
      return undefined;
    const found = this.#held.columns[String(channel)]?.[column];
    return (
      found && {
        n: found.n,
        mean: finite(found.mean),
        sigma: finite(found.sigma),
        min: finite(found.min),
        max: finite(found.max),
      }
    );
  }

  /** Call it when more of the recording is decoded. */
  refresh(): void {
    this.#held = undefined;
  }

  dispose(): void {
    this.#stop.abort();
  }

  async #ask(request: StatisticsRequest): Promise<void> {
    const began = (this.#began = this.clock());
    this.#busy = true;
    try {
      const columns = await this.fetch(this.recording, request, this.#stop.signal);
      if (columns !== undefined) this.#held = { of: request, columns };
      const now = this.clock();
      this.#notBefore = columns === undefined ? now + PATIENCE_MS : now + PAUSE_FACTOR * (now - began);
    } finally {
      this.#busy = false;
    }
  }
}

/**
 * Statistics of a column as displayed: in another frame it is computed from others. A mean follows any linear change, a spread and
 * extremes only if the column is one of the others, possibly with another sign or reference direction.
 */
export function changedStats(
  row: MatrixRow | undefined,
  column: number,
  period: number,
  of: (column: number) => Stats | undefined,
): Stats | undefined {
  if (row === undefined) return of(column);
  const parts = row.terms.map(([from]) => of(from));
  if (!parts.every((part) => part !== undefined)) return undefined;
  const mean = inFrame(row, (from) => of(from)!.mean, period);
  const [only] = parts;
  const factor = row.terms[0]?.[1] ?? 1;
  if (parts.length !== 1 || only === undefined) return { n: parts[0]?.n ?? 0, mean, sigma: NaN, min: NaN, max: NaN };
  const ends = [only.min, only.max].map((v) => factor * v + row.offset).sort((a, b) => a - b);
  return { n: only.n, mean, sigma: only.sigma * Math.abs(factor), min: ends[0]!, max: ends[1]! };
}
