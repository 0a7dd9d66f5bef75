/**
 * Health figures of a device up to a moment of a recording: losses, counted from the events found when the recording was opened;
 * rates, delays and the clock from its seconds (health-history.ts). Unknown figures stay unknown.
 */
import type { DeviceHealth, EventInfo } from "../wire/types";
import type { HealthHistory } from "../wire/routes";
import { figuresAt } from "./health-history";
import type { RecordingDetail } from "../wire/recording-types";

/** Bits on a serial line for each byte: start, eight, stop. */
const BITS = 10;

export function healthAt(
  detail: Pick<RecordingDetail, "t0" | "devices" | "channels" | "events" | "longest_s">,
  device: string,
  t: number,
  history?: HealthHistory,
): DeviceHealth {
  let [gaps, lost, rejects] = [0, 0, 0];
  const by: Record<string, number> = {};
  for (const event of until(detail.events, t)) {
    if (event.device !== device) continue;
    if (event.kind === "gap") {
      gaps += numberOf(event.data["gaps"], 1);
      lost += event.samples;
    } else if (event.kind === "reject") {
      rejects += event.samples;
      const reason = event.data["reason"];
      if (typeof reason === "string") by[reason] = (by[reason] ?? 0) + event.samples;
    }
  }
  const rates = new Map<string, number>();
  for (const { id, device: of, message } of detail.channels) {
    const usual = detail.longest_s[String(id)] ?? 0;
    if (of === device && usual > 0) rates.set(message, Math.max(rates.get(message) ?? 0, 1 / usual));
  }
  const messages = [...rates].map(([name, rate]) => ({ name, rate, count: Math.round(rate * (t - detail.t0)) }));
  const about = detail.devices.find(({ id }) => id === device);
  const capacity = about?.link === "serial" && about.baud !== null ? about.baud / BITS : null;
  return {
    device,
    time: t,
    rate: Math.max(0, ...rates.values()),
    messages,
    gaps,
    lost,
    rejects,
    numbered: NaN,
    unclaimed: NaN,
    bytes: NaN,
    bytes_per_s: NaN,
    capacity,
    jitter_ms: null,
    last_arrival: null,
    drift_ppm: null,
    drift_bound_ppm: null,
    time_presumes: "",
    uncertainty_ms: null,
    rejects_by: by,
    verified: null,
    unverified: null,
    dropped: 0,
    behind: { link: 0, decoding: 0, reason: "" },
    jitter_cause: null,
    ...(history ? figuresAt(history, t) : {}),
  };
}

function numberOf(value: unknown, other: number): number {
  return typeof value === "number" ? value : other;
}

/** The events, in order, that had happened by `t`. */
export function until(events: readonly EventInfo[], t: number): readonly EventInfo[] {
  const end = events.findIndex(({ time }) => time > t);
  return end < 0 ? events : events.slice(0, end);
}

/** Samples of a device lost in gaps after `t`. */
export function lostAfter(events: readonly EventInfo[], device: string, t: number): number {
  return events.reduce(
    (sum, event) => (event.kind === "gap" && event.device === device && event.time > t ? sum + event.samples : sum),
    0,
  );
}
