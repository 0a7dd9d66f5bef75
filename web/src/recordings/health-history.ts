/**
 * Health of a device around the reading position of a recording. From per-second counts made by the server on opening it
 * (recordings/columns/health_history.py) come the health panel's figures and its sparklines of the last minute, as when live.
 */
import { type Moment, MINUTE } from "../data/health-history";
import type { HealthHistory } from "../wire/routes";
import type { DeviceHealth, EventInfo, MessageHealth } from "../wire/types";
import { fetchFared } from "./api";
import type { Bounds } from "./time-range";

/** Rates are those of this many seconds, as live. */
const OVER_S = 2;
/** Live health reports come twice a second. */
const REPORTS: readonly number[] = [0.49, 0.99];
/** Requested on either side, s: playing at 50× then requests every ten seconds. */
const REACH_S = 600;
/** Wait after a refusal before the next request, ms. */
const PATIENCE_MS = 3000;

const sum = (values: readonly number[]): number => values.reduce((all, one) => all + one, 0);

/** Mean per second over the whole seconds before second `k`; undefined before the first. The very first is rarely whole. */
function rateAt(values: readonly number[], k: number, begins: number): number | undefined {
  const from = Math.max(begins + 1, k - OVER_S);
  return k > from ? sum(values.slice(from, k)) / (k - from) : undefined;
}

/** The figures known at `t`; unknown ones are omitted. */
export function figuresAt(history: HealthHistory, t: number): Partial<DeviceHealth> {
  const k = Math.floor(t) - history.first;
  const { bytes } = history;
  if (k < 0 || k >= bytes.length) return {};
  const firstBytes = bytes.findIndex((n) => n > 0);
  const begins = history.before > 0 ? -1 : firstBytes;
  const messages = Object.entries(history.messages).flatMap(([name, counts]): MessageHealth[] => {
    const rate = rateAt(counts, k, begins);
    return rate === undefined
      ? []
      : [{ name, rate, count: (history.counted[name] ?? 0) + sum(counts.slice(0, k + 1)) }];
  });
  messages.sort((a, b) => b.count - a.count);
  const rate = rateAt(bytes, k, begins);
  const last = bytes.slice(0, k + 1).findLastIndex((n) => n > 0);
  return {
    bytes: history.before + sum(bytes.slice(0, k + 1)),
    ...(rate === undefined ? {} : { bytes_per_s: rate }),
    ...(messages.length > 0 ? { messages, rate: Math.max(...messages.map((one) => one.rate)) } : {}),
    ...(last >= 0 ? { last_arrival: Math.min(t, history.first + last + 1) } : {}),
    jitter_ms: history.jitter_ms[k] ?? history.jitter_ms[k - 1] ?? null,
    drift_ppm: history.drift_ppm[k] ?? null,
    drift_bound_ppm: null,
    time_presumes: "",
    uncertainty_ms: history.uncertainty_ms[k] ?? null,
  };
}

/** The minute before `t`, in the form of live reports. */
export function minuteAt(
  history: HealthHistory,
  events: readonly EventInfo[],
  device: string,
  t: number,
): readonly Moment[] {
  const counts = Object.values(history.messages);
  const firstBytes = history.before > 0 ? -1 : history.bytes.findIndex((n) => n > 0);
  const own = events.filter((event) => event.device === device && (event.kind === "gap" || event.kind === "reject"));
  let [gaps, lost, rejects, next] = [0, 0, 0, 0];
  const out: Moment[] = [];
  for (let second = Math.floor(t) - MINUTE; second <= t; second++) {
    const k = second - history.first;
    for (; next < own.length && own[next]!.time < second + 1; next++) {
      const { kind, samples } = own[next]!;
      if (kind === "gap") [gaps, lost] = [gaps + 1, lost + samples];
      else rejects += samples;
    }
    if (k < 0 || k >= history.bytes.length || (firstBytes >= 0 && k < firstBytes)) continue;
    const whole = second + 1 <= t;
    // the current second counts as the one before it: half a second's samples are not a lower rate
    const rate = Math.max(0, ...counts.map((one) => one[whole ? k : Math.max(0, k - 1)] ?? 0));
    const moment = {
      rate,
      gaps,
      lost,
      rejects,
      jitter: history.jitter_ms[k] ?? undefined,
      drift: history.drift_ppm[k] ?? undefined,
    };
    for (const part of REPORTS) if (second + part <= t) out.push({ ...moment, time: second + part });
  }
  return out;
}

/** Holds the seconds around the reading position and requests others as it moves. */
export class HealthHistoryFeed {
  /** Incremented with every answer. */
  version = 0;
  readonly #stop = new AbortController();
  #held: { readonly device: string; readonly history: HealthHistory } | undefined;
  #busy = false;
  #notBefore = -Infinity;

  constructor(
    readonly recording: string,
    readonly bounds: Bounds,
  ) {}

  /** The seconds around `t`, as far as loaded. */
  at(device: string, t: number): HealthHistory | undefined {
    const held = this.#held?.device === device ? this.#held.history : undefined;
    const { first, last } = this.bounds;
    const from = Math.max(t - MINUTE - 1, first);
    if (held === undefined || held.first > from || held.first + held.bytes.length <= Math.min(t + 1, last))
      this.#ask(device, t);
    return held;
  }

  /** Call it when more of the recording is decoded. */
  refresh(): void {
    this.#held = undefined;
  }

  dispose(): void {
    this.#stop.abort();
  }

  #ask(device: string, t: number): void {
    if (this.#busy || performance.now() < this.#notBefore) return;
    this.#busy = true;
    const [t0, t1] = [
      Math.floor(Math.max(t - MINUTE - REACH_S, this.bounds.first - 1)),
      Math.ceil(Math.min(t + REACH_S, this.bounds.last + 1)),
    ];
    void fetchFared(this.recording, device, t0, t1, this.#stop.signal)
      .then((history) => {
        if (history === undefined) this.#notBefore = performance.now() + PATIENCE_MS;
        else [this.#held, this.version] = [{ device, history }, this.version + 1];
      })
      .finally(() => (this.#busy = false));
  }
}
