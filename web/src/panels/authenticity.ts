/**
 * Can it be known that a device sent these data, and that they are whole? Pure: what the server tells of the frames' protection
 * becomes a mark and a word, and what was rejected becomes a count for each reason. Only protocols that protect frames in
 * different ways (IDTP) tell anything; of the others every frame passed its check.
 */
import { count } from "../ui/format";
import type { DeviceHealth, DeviceInfo } from "../wire/types";

export interface Trust {
  /** Shape and word; a caution for data that nobody could check. */
  readonly mark: "●" | "▲" | "○";
  readonly word: "verified" | "unverified" | "not protected" | "partly protected";
  readonly tone: "" | "warn";
  /** What protects the frames: "Safety, CRC-32". */
  readonly detail: string;
}

/** The trust in a device's data; undefined where its protocol tells nothing, or nothing was shown so far. */
export function trustOf(device: Pick<DeviceInfo, "protection">, health: DeviceHealth | undefined): Trust | undefined {
  const verified = health?.verified ?? 0;
  const unverified = health?.unverified ?? 0;
  const detail = device.protection;
  if (unverified > 0 || /unverified/i.test(detail)) {
    return { mark: "▲", word: "unverified", tone: "warn", detail: detail.replace(/,? unverified/i, "") };
  }
  // A Lite frame is checked in its header alone: its payload may be anything.
  if (/^lite/i.test(detail)) return { mark: "○", word: "not protected", tone: "", detail };
  if (/\blite\b/i.test(detail)) return { mark: "○", word: "partly protected", tone: "", detail };
  if (verified > 0 || detail !== "") return { mark: "●", word: "verified", tone: "", detail: detail.replace(/, verified/i, "") };
  return undefined;
}

/** Reasons of rejection in words. */
const REASONS: Readonly<Record<string, string>> = {
  no_key: "no key",
  bad_hmac: "wrong key or forged",
  bad_crc8: "bad header check",
  bad_crc32: "bad CRC-32",
  below_min_mode: "mode too weak",
  stale: "old sequence number",
  far_ahead: "sequence number far ahead",
  bad_id: "unknown number",
  bad_version: "other version",
  bad_mode: "unknown mode",
  indt: "successor protocol (INDT)",
  bad_nmea: "bad NMEA line",
};

export interface Rejection {
  readonly reason: string;
  readonly words: string;
  readonly count: number;
}

/** What was rejected, by reason, most first. */
export function rejections(health: DeviceHealth | undefined): readonly Rejection[] {
  const all = Object.entries(health?.rejects_by ?? {}).filter(([, n]) => n > 0);
  return all.sort(([, a], [, b]) => b - a).map(([reason, n]) => ({ reason, words: REASONS[reason] ?? reason.replaceAll("_", " "), count: n }));
}

/** What to say while frames are refused because nobody gave a key; "" when none are. */
export function keyWanted(health: DeviceHealth | undefined): string {
  const refused = health?.rejects_by["no_key"] ?? 0;
  return refused > 0 ? `${count(refused, "Secure frame")} rejected: there is no key to check them.` : "";
}

/** The key that was given does not fit: nothing verified came, and frames fail their check. */
export function keyWrong(health: DeviceHealth | undefined): string {
  const refused = health?.rejects_by["bad_hmac"] ?? 0;
  return refused > 0 && !health?.verified ? `${count(refused, "Secure frame")} rejected: the key does not fit them.` : "";
}
