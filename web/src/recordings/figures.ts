/**
 * How did a device fare up to a moment of a recording? The health panel's figures, counted from what was found when the recording was
 * opened. What only a live link can tell (its load, how late bytes came) is not made up.
 */
import type { DeviceHealth, EventInfo } from "../wire/types";
import type { RecordingDetail } from "./types";

export function healthAt(detail: Pick<RecordingDetail, "t0" | "channels" | "events" | "longest_s">, device: string, t: number): DeviceHealth {
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
  return {
    device, time: t, rate: Math.max(0, ...rates.values()), messages, gaps, lost, rejects, bytes: NaN, bytes_per_s: NaN, capacity: null,
    jitter_ms: null, last_arrival: null, drift_ppm: null, uncertainty_ms: null, rejects_by: by, verified: null, unverified: null, dropped: 0,
  };
}

function numberOf(value: unknown, other: number): number {
  return typeof value === "number" ? value : other;
}

/** Of events in their order, those that had happened by `t`. */
export function until(events: readonly EventInfo[], t: number): readonly EventInfo[] {
  const end = events.findIndex(({ time }) => time > t);
  return end < 0 ? events : events.slice(0, end);
}
