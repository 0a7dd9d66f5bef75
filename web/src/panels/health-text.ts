/** Words and numbers of the health figures. Pure; shared by the health panel and the phone's strip. */
import { age, byteRate, clock, number, type Quantity, signed } from "../ui/format/format";
import { TOLD_S } from "../data/behind";
import { countsLosses, embeddedKinds, MESSAGES, protocolOf } from "../wire/capabilities";
import type { ChannelInfo, DeviceHealth, DeviceInfo, EventInfo } from "../wire/types";
import { type FigureTone, toneOf } from "./tones";
import { TEXT } from "../texts/panels";

export interface HealthQuantity extends Quantity {
  readonly tone: FigureTone;
}

const plain = (quantity: Quantity): HealthQuantity => ({ ...quantity, tone: "" });

type Sent = Pick<ChannelInfo, "name" | "group">;

interface Figures {
  readonly samples: HealthQuantity;
  readonly gaps: HealthQuantity;
  readonly rejects: HealthQuantity;
  readonly bytes: HealthQuantity;
  /** Share of the link's capacity in 0..1; undefined if the capacity is unknown. */
  readonly share: number | undefined;
  readonly shareText: HealthQuantity;
  readonly jitter: HealthQuantity;
  readonly age: HealthQuantity;
  readonly dropped: HealthQuantity;
  readonly drift: HealthQuantity;
  readonly uncertainty: HealthQuantity;
}

export type HealthKey = Exclude<keyof Figures, "share">;

/** Rows about the link and the clock of a device, which messages of its driver do not tell. */
const OF_DEVICES: readonly HealthKey[] = ["shareText", "jitter", "drift", "uncertainty"];

/** Rows about the link and this browser now, which a recording does not tell. */
const OF_NOW: readonly HealthKey[] = ["shareText", "age", "dropped"];

/** Whether a row has no meaning for that source. */
export function isLeftOut(
  key: HealthKey,
  device: Pick<DeviceInfo, "protocol"> | undefined,
  isRecording: boolean,
): boolean {
  return (device?.protocol === MESSAGES && OF_DEVICES.includes(key)) || (isRecording && OF_NOW.includes(key));
}

/** A device is late after this, and after so many of its usual steps. */
const LATE_S = 1;
const LATE_STEPS = 3;

/** Problems within the last minute. */
export interface Recent {
  readonly gaps: number;
  readonly lost: number;
  /** Length of the gaps without a known number of missing samples, s. */
  readonly blind: number;
  readonly rejects: number;
}

const MINUTE_S = 60;

/** Counted from the events, which a newly opened page has as well; one event may sum up many gaps. */
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

/** "2 · 72 smp", "1 · 15 s" if a link was down and nothing counted, "3 · 72 smp + 15 s". */
function gapWords({ gaps, lost, blind }: Recent): string {
  const down = age(blind);
  const parts = [
    lost > 0 || blind === 0 ? TEXT.samplesShort(number(lost, 0)) : "",
    blind > 0 ? `${down.value} ${down.unit}` : "",
  ];
  return `${number(gaps, 0)} · ${parts.filter(Boolean).join(" + ")}`;
}

/** Counter totals, beside the figures of the last minute. */
export function totals(health: DeviceHealth | undefined): string {
  if (!health) return "";
  return TEXT.sinceSessionBegan(health.gaps, health.lost, health.rejects, health.unclaimed);
}

/**
 * The figures of one device. What is not known is "—": while decoding is behind, its rate and that nothing was lost; before its first
 * samples, that none was lost.
 *
 * @param recent problems in the last minute, for gaps and rejects; older ones are in `totals`.
 * @param old seconds since the last sample arrived.
 * @param expected whether samples should be coming: false for a file that has ended, whose age is not a fault.
 * @param counted whether lost samples are counted at all.
 * @param step usual time between samples, s; Infinity: unknown, so that no age is too old.
 */
export function healthFigures(
  health: DeviceHealth | undefined,
  recent: Recent,
  old: number | undefined,
  dropped: number,
  expected = true,
  counted = true,
  step = 0,
): Figures {
  const known = health !== undefined && !isBehind(health);
  const late = Math.max(LATE_S, LATE_STEPS * step);
  const share = health?.capacity ? health.bytes_per_s / health.capacity : undefined;
  const jitter = health?.jitter_ms ?? undefined;
  return {
    samples: plain({ value: number(known ? health.rate : undefined, 1), unit: "/s" }),
    gaps:
      recent.gaps > 0
        ? { value: gapWords(recent), unit: "", tone: toneOf("count", recent.gaps) }
        : plain({ value: number(known && counted && hasSamples(health) ? 0 : undefined, 0), unit: TEXT.samplesUnit }),
    rejects: {
      value: number(recent.rejects > 0 || (known && health.bytes !== 0) ? recent.rejects : undefined, 0),
      unit: TEXT.framesUnit(recent.rejects),
      tone: toneOf("count", recent.rejects),
    },
    bytes: plain(byteRate(health?.bytes_per_s)),
    share,
    shareText: {
      value: number(share === undefined ? undefined : share * 100, 1),
      unit: "%",
      tone: toneOf("share", share),
    },
    jitter: plain({ value: number(jitter, (jitter ?? 0) < 100 ? 2 : 0), unit: TEXT.msP99 }),
    age: {
      ...agoOf(health === undefined || known ? old : undefined),
      tone: expected && known && old !== undefined ? toneOf("lateness", old / late) : "",
    },
    dropped: { value: number(dropped, 0), unit: TEXT.samplesUnit, tone: toneOf("count", dropped) },
    drift: plain({ value: driftOf(health), unit: "ppm" }),
    uncertainty: boundOf(health),
  };
}

function driftOf(health: DeviceHealth | undefined): string {
  const [drift, bound] = [health?.drift_ppm ?? undefined, health?.drift_bound_ppm ?? undefined];
  if (bound === undefined) return signed(drift, 1);
  const digits = bound >= 10 ? 0 : 1; // more do not fit, and say nothing
  return `${signed(drift, digits)} ± ${number(Math.ceil(bound * 10 ** digits - 1e-9) / 10 ** digits, digits)}`;
}

/** "± 0.4 ms": never rounded below its value. */
function boundOf(health: DeviceHealth | undefined): HealthQuantity {
  const bound = health?.uncertainty_ms ?? undefined;
  const digits = bound === undefined || bound >= 10 ? 0 : bound >= 0.1 ? 1 : 2;
  const up = bound === undefined ? undefined : Math.ceil(bound * 10 ** digits - 1e-9) / 10 ** digits;
  return {
    value: up === undefined ? number(up, 0) : `± ${number(up, digits)}`,
    unit: "ms",
    tone: toneOf("uncertainty", bound),
  };
}

/** What both ± presume, or why they are unknown; "" where neither is so. */
export function presumedWords(health: DeviceHealth | undefined): string {
  if (!health?.time_presumes) return "";
  return health.uncertainty_ms === null
    ? TEXT.timesUnknown(health.time_presumes)
    : TEXT.boundHolds(health.time_presumes);
}

/** Cause of uneven arrival times and its remedy; "" while they are even. */
export function timeWords(health: DeviceHealth | undefined): string {
  const cause = health?.jitter_cause;
  return cause ? `${cause.text} ${cause.remedy}` : "";
}

function agoOf(old: number | undefined): Quantity {
  const { value, unit } = age(old);
  return { value, unit: unit ? TEXT.unitAgo(unit) : "" };
}

/** Whether decoding is behind the received data, so that figures of decoded data are out of date. */
function isBehind({ behind }: DeviceHealth): boolean {
  return behind.decoding > TOLD_S;
}

function hasSamples(health: DeviceHealth): boolean {
  return health.messages.some(({ count }) => count > 0);
}

/**
 * Where data was lost last, or that none was; or what prevents to know it.
 *
 * @param channels what the device sends.
 * @param later samples of a recording missing after the reading position.
 */
export function verdict(
  device: DeviceInfo | undefined,
  channels: readonly Sent[],
  events: readonly EventInfo[],
  health: DeviceHealth | undefined,
  dropped: number,
  later?: number,
): string {
  if (!device) return "";
  if (device.status === "lost" || device.status === "denied")
    return [device.message, device.hint].filter(Boolean).join(" ");
  const here = dropped > 0 ? TEXT.droppedVerdict(dropped) : "";
  return [here, deviceVerdict(device, channels, events, health, later)].filter(Boolean).join(" ");
}

function deviceVerdict(
  device: DeviceInfo,
  channels: readonly Sent[],
  events: readonly EventInfo[],
  health: DeviceHealth | undefined,
  later: number | undefined,
): string {
  const gap = events.findLast((event) => event.device === device.id && event.kind === "gap");
  if (gap) return TEXT.gapVerdict(clock(gap.t0 ?? gap.time), sentence(gap.text));
  if (health && health.lost > 0) return TEXT.lostBeforeVerdict(health.lost);
  if (health && isBehind(health)) return TEXT.behindVerdict;
  const counted = countsLosses(device, channels);
  if (health && health.rejects > 0)
    return [TEXT.rejectsVerdict(health.rejects), counted ? TEXT.noneMissing : unknownLosses(device, channels)].join(
      " ",
    );
  if (later !== undefined && later > 0) return TEXT.lostLaterVerdict(later);
  if (!health) return "";
  if (later === undefined && !hasSamples(health)) return TEXT.noSamplesYet;
  if (!counted) return unknownLosses(device, channels);
  return later === undefined ? TEXT.noLossInSession : TEXT.noLossInRecording;
}

/** Why lost samples of a device are not counted, and what to do. */
function unknownLosses(device: DeviceInfo, channels: readonly Sent[]): string {
  if (device.protocol === MESSAGES) return TEXT.lossesUnknown;
  const counter = embeddedKinds(channels).size === 0 ? protocolOf(device.protocol)?.counter : "";
  return counter ? TEXT.lossesWithout(counter) : TEXT.lossesUnnumbered;
}

function sentence(text: string): string {
  return /[.!?]$/.test(text) ? text : `${text}.`;
}
