/** What to switch on for an attitude, when a device sends none. */
import type { Channel } from "../data/channels";
import { TEXT } from "../texts/attitude";

const EMBEDDED = /^(UBX|NMEA|RTCM3) /;

/**
 * The hint of the device's family, unless all that it sends is embedded (UBX, NMEA): a receiver alone is read by a family that it does
 * not belong to, and cannot stream that family's outputs.
 */
export function attitudeHint(channels: readonly Channel[], ofFamily: string): string {
  const kinds = new Set(channels.map(({ info }) => EMBEDDED.exec(info.group)?.[1]));
  if (kinds.size === 0 || kinds.has(undefined)) return ofFamily;
  return kinds.has("UBX") ? TEXT.ubxAttitude : TEXT.nmeaAttitude;
}
