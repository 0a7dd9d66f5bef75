/**
 * Authenticity and integrity of a device's data. Pure: the server's report on the frames' protection becomes a mark and a word,
 * and rejects become a count for each reason. Only protocols with several kinds of protection (IDTP) report anything; for the others
 * every frame passed its check.
 */
import type { DeviceHealth, DeviceInfo } from "../wire/types";
import { TEXT } from "../texts/panels";

export interface Trust {
  /** Shape and word; a caution for data that could not be verified. */
  readonly mark: "●" | "▲" | "○";
  readonly state: keyof typeof TEXT.trust;
  readonly word: string;
  readonly tone: "" | "warn";
  /** Protection of the frames: "Safety, CRC-32". */
  readonly detail: string;
}

/** The trust in a device's data; undefined if its protocol reports nothing, or no data was shown yet. */
export function trustOf(device: Pick<DeviceInfo, "protection">, health: DeviceHealth | undefined): Trust | undefined {
  const verified = health?.verified ?? 0;
  const unverified = health?.unverified ?? 0;
  const detail = device.protection;
  if (unverified > 0 || /unverified/i.test(detail)) {
    return {
      mark: "▲",
      state: "unverified",
      word: TEXT.trust.unverified,
      tone: "warn",
      detail: detail.replace(/,? unverified/i, ""),
    };
  }
  // a Lite frame checks only its header: its payload may be anything
  if (/^lite/i.test(detail))
    return { mark: "○", state: "not protected", word: TEXT.trust["not protected"], tone: "", detail };
  if (/\blite\b/i.test(detail))
    return { mark: "○", state: "partly protected", word: TEXT.trust["partly protected"], tone: "", detail };
  if (verified > 0 || detail !== "")
    return {
      mark: "●",
      state: "verified",
      word: TEXT.trust.verified,
      tone: "",
      detail: detail.replace(/, verified/i, ""),
    };
  return undefined;
}

/** Reasons of rejection in words. */
const REASONS: Readonly<Record<string, string>> = {
  no_key: TEXT.noKey,
  bad_hmac: TEXT.wrongKeyOrForged,
  bad_crc8: TEXT.headerChecksumError,
  bad_crc32: TEXT.crc32Error,
  below_min_mode: TEXT.modeTooWeak,
  stale: TEXT.oldSequenceNumber,
  far_ahead: TEXT.sequenceNumberFarAhead,
  bad_id: TEXT.unknownId,
  bad_version: TEXT.otherVersion,
  bad_mode: TEXT.unknownMode,
  successor: TEXT.successorProtocol,
  bad_nmea: TEXT.invalidNmea,
};

export interface Rejection {
  readonly reason: string;
  readonly words: string;
  readonly count: number;
}

/** Rejects by reason, most frequent first. */
export function rejections(health: DeviceHealth | undefined): readonly Rejection[] {
  const all = Object.entries(health?.rejects_by ?? {}).filter(([, n]) => n > 0);
  return all
    .sort(([, a], [, b]) => b - a)
    .map(([reason, n]) => ({ reason, words: REASONS[reason] ?? reason.replaceAll("_", " "), count: n }));
}

/** Message while frames are refused for lack of a key; "" otherwise. */
export function keyWanted(health: DeviceHealth | undefined): string {
  const refused = health?.rejects_by["no_key"] ?? 0;
  return refused > 0 ? TEXT.rejectedWithoutKey(refused) : "";
}

/** Message if the given key does not fit: nothing was verified, and frames fail their check. */
export function keyWrong(health: DeviceHealth | undefined): string {
  const refused = health?.rejects_by["bad_hmac"] ?? 0;
  return refused > 0 && !health?.verified ? TEXT.rejectedByKey(refused) : "";
}
