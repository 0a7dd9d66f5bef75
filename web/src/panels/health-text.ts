/** What do the health figures say? Pure: reports in, words and numbers out; the health panel and the phone's strip print the same. */
import { age, byteRate, clock, count, number, type Quantity, signed } from "../ui/format";
import type { DeviceHealth, DeviceInfo, EventInfo } from "../wire/types";

export type Tone = "" | "warn" | "bad";

export interface Figure extends Quantity {
  readonly tone: Tone;
}

const plain = (quantity: Quantity): Figure => ({ ...quantity, tone: "" });

export interface Figures {
  readonly samples: Figure;
  readonly gaps: Figure;
  readonly rejects: Figure;
  readonly bytes: Figure;
  /** Share of the link's capacity in 0..1; undefined where the link has none that is known. */
  readonly share: number | undefined;
  readonly shareText: Figure;
  readonly jitter: Figure;
  readonly age: Figure;
  readonly dropped: Figure;
  readonly drift: Figure;
  readonly uncertainty: Figure;
}

/** Past this a live device is late: no message that streams comes slower than once a second without being called idle. */
const LATE_S = 1;
/** A link this full has no room for a burst. */
const FULL = 0.9;

/** What went wrong within the last minute. */
export interface Recent {
  readonly gaps: number;
  readonly lost: number;
  /** Length of the gaps of which nobody can say how many samples are missing, s. */
  readonly blind: number;
  readonly rejects: number;
}

const MINUTE_S = 60;

/** Counted from the events, which a page that has just been opened has as well; one event may sum up many gaps. */
export function recentOf(events: readonly EventInfo[], device: string, now: number): Recent {
  let [gaps, lost, blind, rejects] = [0, 0, 0, 0];
  for (const event of events) {
    if (event.device !== device || event.time < now - MINUTE_S) continue;
    if (event.kind === "gap") {
      const summed = event.data["gaps"];
      gaps += typeof summed === "number" ? summed : 1;
      lost += event.samples;
      if (event.samples === 0 && event.t0 !== null && event.t1 !== null) blind += event.t1 - event.t0;
    } else if (event.kind === "reject") rejects += event.samples;
  }
  return { gaps, lost, blind, rejects };
}

/** "2 · 72 smp", "1 · 15 s" where a link was down and nothing counted, "3 · 72 smp + 15 s". */
function gapWords({ gaps, lost, blind }: Recent): string {
  const down = age(blind);
  const parts = [lost > 0 || blind === 0 ? `${number(lost, 0)} smp` : "", blind > 0 ? `${down.value} ${down.unit}` : ""];
  return `${number(gaps, 0)} · ${parts.filter(Boolean).join(" + ")}`;
}

/** What the counters stand at, beside the figures of the last minute. */
export function totals(health: DeviceHealth | undefined): string {
  if (!health) return "";
  return `Since the session began: ${count(health.gaps, "gap")}, ${count(health.lost, "sample")} lost, ${count(health.rejects, "frame")} rejected.`;
}

/**
 * The figures of one device.
 *
 * @param recent what went wrong in the last minute: that is what is told of gaps and rejects; older ones are history (`totals`).
 * @param old seconds since the last sample arrived.
 * @param expected samples should be coming: false for a file that has ended, whose age is no fault.
 */
export function figuresOf(
  health: DeviceHealth | undefined,
  recent: Recent,
  old: number | undefined,
  dropped: number,
  expected = true,
): Figures {
  const share = health?.capacity ? health.bytes_per_s / health.capacity : undefined;
  const jitter = health?.jitter_ms ?? undefined;
  return {
    samples: plain({ value: number(health?.rate, 1), unit: "/s" }),
    gaps: recent.gaps > 0 ? { value: gapWords(recent), unit: "", tone: "warn" } : plain({ value: number(health && 0, 0), unit: "smp" }),
    rejects: { value: number(health && recent.rejects, 0), unit: recent.rejects === 1 ? "frame" : "frames", tone: recent.rejects > 0 ? "warn" : "" },
    bytes: plain(byteRate(health?.bytes_per_s)),
    share,
    shareText: { value: number(share === undefined ? undefined : share * 100, 1), unit: "%", tone: (share ?? 0) > FULL ? "warn" : "" },
    jitter: plain({ value: number(jitter, (jitter ?? 0) < 100 ? 2 : 0), unit: "ms p99" }),
    age: { ...agoOf(old), tone: expected && old !== undefined && old > LATE_S ? "bad" : "" },
    dropped: { value: number(dropped, 0), unit: "smp", tone: dropped > 0 ? "warn" : "" },
    drift: plain({ value: signed(health?.drift_ppm ?? undefined, 1), unit: "ppm" }),
    uncertainty: boundOf(health),
  };
}

/** "± 0.4 ms": never rounded to less than it is. Coloured while something makes the times uneven that could be mended. */
function boundOf(health: DeviceHealth | undefined): Figure {
  const bound = health?.uncertainty_ms ?? undefined;
  const digits = bound === undefined || bound >= 10 ? 0 : bound >= 0.1 ? 1 : 2;
  const up = bound === undefined ? undefined : Math.ceil(bound * 10 ** digits - 1e-9) / 10 ** digits;
  return { value: up === undefined ? number(up, 0) : `± ${number(up, digits)}`, unit: "ms", tone: health?.time_cause ? "warn" : "" };
}

/** Why arrival times are uneven, and what helps; "" while they are not. */
export function timeWords(health: DeviceHealth | undefined): string {
  const cause = health?.time_cause;
  return cause ? `${cause.text} ${cause.remedy}` : "";
}

function agoOf(old: number | undefined): Quantity {
  const { value, unit } = age(old);
  return { value, unit: unit ? `${unit} ago` : "" };
}

/** One sentence: who lost it last, or that nothing was lost. `later`: of a recording, samples that are missing after where it is read. */
export function verdict(
  device: DeviceInfo | undefined,
  events: readonly EventInfo[],
  health: DeviceHealth | undefined,
  dropped: number,
  later?: number,
): string {
  if (!device) return "";
  if (device.status === "lost" || device.status === "denied") return [device.message, device.hint].filter(Boolean).join(" ");
  if (dropped > 0) {
    return `${count(dropped, "sample")} not sent to this browser, because it did not keep up. Nothing else lost them.`;
  }
  const gap = events.findLast((event) => event.device === device.id && event.kind === "gap");
  if (gap) return `Gap ${clock(gap.t0 ?? gap.time)}: ${sentence(gap.text)}`;
  if (health && health.rejects > 0) return `${count(health.rejects, "frame")} failed the check and ${health.rejects === 1 ? "was" : "were"} left out; no counter says that samples are missing.`;
  if (later !== undefined && later > 0) return `Nothing was lost up to here; ${count(later, "sample is", "samples are")} missing further on.`;
  if (!health) return "";
  return later === undefined ? "Nothing was lost since this session began." : "Nothing was lost in this recording.";
}

function sentence(text: string): string {
  return /[.!?]$/.test(text) ? text : `${text}.`;
}
