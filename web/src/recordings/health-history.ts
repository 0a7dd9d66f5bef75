/**
 * How did a device fare around where its recording is read? Seconds that the server counted when it opened the recording
 * (recordings/health_history.py): they make the health panel's figures and its little pictures of the last minute what they were live.
 */
import { type Moment, MINUTE } from "../panels/health-history";
import type { DeviceHealth, EventInfo, MessageHealth } from "../wire/types";
import { fetchFared } from "./api";
import type { Bounds } from "./time-range";

/** A value for each second from `first` on; null: nothing is known. */
export interface Fared {
  readonly first: number;
  /** Bytes that had come by then. */
  readonly before: number;
  readonly bytes: readonly number[];
  readonly jitter_ms: readonly (number | null)[];
  readonly drift_ppm: readonly (number | null)[];
  readonly uncertainty_ms: readonly (number | null)[];
  readonly messages: Readonly<Record<string, readonly number[]>>;
  /** Samples of each message before `first`. */
  readonly counted: Readonly<Record<string, number>>;
}

/** Rates are those of this many seconds, as live. */
const OVER_S = 2;
/** A live device is told of twice a second. */
const REPORTS: readonly number[] = [0.49, 0.99];
/** Asked for on either side, s: playing it at 50× asks every ten seconds. */
const REACH_S = 600;
/** After a refusal it is not asked again at once, ms. */
const PATIENCE_MS = 3000;

const sum = (values: readonly number[]): number => values.reduce((all, one) => all + one, 0);

/** Mean a second over the whole seconds before second `k`; undefined before there is one. The very first is seldom whole. */
function rateAt(values: readonly number[], k: number, begins: number): number | undefined {
  const from = Math.max(begins + 1, k - OVER_S);
  return k > from ? sum(values.slice(from, k)) / (k - from) : undefined;
}

/** The figures that seconds tell: those that say nothing there are left out. */
export function figuresAt(fared: Fared, t: number): Partial<DeviceHealth> {
  const k = Math.floor(t) - fared.first;
  const { bytes } = fared;
  if (k < 0 || k >= bytes.length) return {};
  const heard = bytes.findIndex((n) => n > 0);
  const begins = fared.before > 0 ? -1 : heard;
  const messages = Object.entries(fared.messages).flatMap(([name, counts]): MessageHealth[] => {
    const rate = rateAt(counts, k, begins);
    return rate === undefined ? [] : [{ name, rate, count: (fared.counted[name] ?? 0) + sum(counts.slice(0, k + 1)) }];
  });
  messages.sort((a, b) => b.count - a.count);
  const rate = rateAt(bytes, k, begins);
  const last = bytes.slice(0, k + 1).findLastIndex((n) => n > 0);
  return {
    bytes: fared.before + sum(bytes.slice(0, k + 1)),
    ...(rate === undefined ? {} : { bytes_per_s: rate }),
    ...(messages.length > 0 ? { messages, rate: Math.max(...messages.map((one) => one.rate)) } : {}),
    ...(last >= 0 ? { last_arrival: Math.min(t, fared.first + last + 1) } : {}),
    jitter_ms: fared.jitter_ms[k] ?? fared.jitter_ms[k - 1] ?? null,
    drift_ppm: fared.drift_ppm[k] ?? null,
    uncertainty_ms: fared.uncertainty_ms[k] ?? null,
  };
}

/** The minute before `t`, as reports of the live page would have told it. */
export function minuteAt(fared: Fared, events: readonly EventInfo[], device: string, t: number): readonly Moment[] {
  const counts = Object.values(fared.messages);
  const heard = fared.before > 0 ? -1 : fared.bytes.findIndex((n) => n > 0);
  const own = events.filter((event) => event.device === device && (event.kind === "gap" || event.kind === "reject"));
  let [gaps, lost, rejects, next] = [0, 0, 0, 0];
  const out: Moment[] = [];
  for (let second = Math.floor(t) - MINUTE; second <= t; second++) {
    const k = second - fared.first;
    for (; next < own.length && own[next]!.time < second + 1; next++) {
      const { kind, samples } = own[next]!;
      if (kind === "gap") [gaps, lost] = [gaps + 1, lost + samples];
      else rejects += samples;
    }
    if (k < 0 || k >= fared.bytes.length || (heard >= 0 && k < heard)) continue;
    const whole = second + 1 <= t;
    // The second that is under way counts as the one before it: half a second's samples are no lower rate.
    const rate = Math.max(0, ...counts.map((one) => one[whole ? k : Math.max(0, k - 1)] ?? 0));
    const moment = { rate, gaps, lost, rejects, jitter: fared.jitter_ms[k] ?? undefined, drift: fared.drift_ppm[k] ?? undefined };
    for (const part of REPORTS) if (second + part <= t) out.push({ ...moment, time: second + part });
  }
  return out;
}

/** Has the seconds around where it is read, asking for others as that moves on. */
export class FaredFeed {
  /** Goes up with every answer. */
  version = 0;
  readonly #stop = new AbortController();
  #held: { readonly device: string; readonly fared: Fared } | undefined;
  #busy = false;
  #notBefore = -Infinity;

  constructor(
    readonly recording: string,
    readonly bounds: Bounds,
  ) {}

  /** The seconds around `t`, as far as they are here. */
  at(device: string, t: number): Fared | undefined {
    const held = this.#held?.device === device ? this.#held.fared : undefined;
    const { first, last } = this.bounds;
    const from = Math.max(t - MINUTE - 1, first);
    if (held === undefined || held.first > from || held.first + held.bytes.length <= Math.min(t + 1, last)) this.#ask(device, t);
    return held;
  }

  /** More of the recording is decoded. */
  refresh(): void {
    this.#held = undefined;
  }

  dispose(): void {
    this.#stop.abort();
  }

  #ask(device: string, t: number): void {
    if (this.#busy || performance.now() < this.#notBefore) return;
    this.#busy = true;
    const [t0, t1] = [Math.floor(Math.max(t - MINUTE - REACH_S, this.bounds.first - 1)), Math.ceil(Math.min(t + REACH_S, this.bounds.last + 1))];
    void fetchFared(this.recording, device, t0, t1, this.#stop.signal)
      .then((fared) => {
        if (fared === undefined) this.#notBefore = performance.now() + PATIENCE_MS;
        else [this.#held, this.version] = [{ device, fared }, this.version + 1];
      })
      .finally(() => (this.#busy = false));
  }
}
