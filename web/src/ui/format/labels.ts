/**
 * Readable labels of a document's own names: "ClipAccX" → "Clip acc X", "HDG_ALIGN_FINE" → "Heading align fine"; and unique titles
 * for quantities that share one. Pure; titles themselves come with the channels.
 */
import { abbreviations } from "../../wire/capabilities";
import type { ChannelInfo } from "../../wire/types";

/** Parts of constants that are abbreviations. */
const KEPT = new Set([
  ..."AHRS BIT CNO CPU DGPS DMA DOP EKF GNSS GPS IMU INS LLA NMEA PPS RTK RTCM RTOS SBAS SPI UDP USB UTC VRS".split(
    " ",
  ),
  ..."2D 3D A B X Y Z".split(" "),
]);
/** Parts that abbreviate a word. */
const SPELLED: Readonly<Record<string, string>> = {
  ACC: "acceleration",
  CAL: "calibration",
  COM: "port",
  ERR: "error",
  FIX: "fix",
  GYR: "gyro",
  HDG: "heading",
  HDW: "hardware",
  MAG: "magnetometer",
  NAV: "navigation",
  POS: "position",
  RECAL: "recalibration",
  REF: "reference",
  RX: "receive",
  TX: "transmit",
  TIMESYNC: "time sync",
  VEL: "velocity",
  BDS: "BeiDou",
  BEI: "BeiDou",
  GAL: "Galileo",
  GLO: "GLONASS",
  IME: "IMES",
  IRN: "NavIC",
  QZS: "QZSS",
  SBS: "SBAS",
  SATS: "satellites",
  NUM: "number of",
  TEMP: "temperature",
};

/** Names read as one word with another spelling. */
const SPECIAL: Readonly<Record<string, string>> = {
  rtk: "RTK",
  gnss: "GNSS",
  gps: "GPS",
  imu: "IMU",
  ins: "INS",
  selftest: "self-test",
};

/** A name written as a constant: capitals, digits and underscores only. */
const CONSTANT = /^[A-Z0-9]+(_[A-Z0-9]+)*$/;

function constantWords(name: string): string {
  const parts = name
    .replace(/^FLAGS_/, "")
    .replace(/^GPS\d?_(?=RTK)/, "")
    .split("_");
  return parts
    .map((part) =>
      KEPT.has(part) || abbreviations.value.has(part) || /^GPS\d$/.test(part)
        ? part
        : (SPELLED[part] ?? part.toLowerCase()),
    )
    .join(" ");
}

/** A name as words, starting with a capital if it is a constant. */
export function labelWords(name: string): string {
  if (/\s/.test(name)) return name;
  if (CONSTANT.test(name) && name.length > 1) {
    const text = constantWords(name);
    return text.charAt(0).toUpperCase() + text.slice(1);
  }
  const parts = name
    .replace(/([a-z])([A-Z0-9])/g, "$1 $2")
    .replace(/([A-Z]+)([A-Z][a-z])/g, "$1 $2")
    .split(/[ _]+/);
  const said = parts
    .map(
      (part, k) =>
        SPECIAL[part.toLowerCase()] ??
        (k === 0 || part.length === 1 || part === part.toUpperCase() ? part : part.toLowerCase()),
    )
    .join(" ");
  return /^[A-Z]/.test(parts[0] ?? "") ? said.charAt(0).toUpperCase() + said.slice(1) : said;
}

/** Meaning of an enumeration's value, in the middle of a sentence: "RTK fix", "none". */
export function choiceWords(choice: string): string {
  return CONSTANT.test(choice) && choice.length > 1 ? constantWords(choice) : choice;
}

/** Title of each channel among those of its device; two with the same title get their message added. */
export function titlesOf(infos: readonly ChannelInfo[]): (info: ChannelInfo) => string {
  const seen = new Map<string, number>();
  for (const { title } of infos) seen.set(title, (seen.get(title) ?? 0) + 1);
  return ({ title, name, group }) => {
    const own = title || name;
    return group !== "" && group !== own && (seen.get(title) ?? 0) > 1 ? `${own} · ${group}` : own;
  };
}
