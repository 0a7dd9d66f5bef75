import type { Channel } from "../data/channels";
import { TEXT } from "../texts/attitude";

/** What gives an attitude: the hint of the family, but for a receiver alone (UBX, NMEA), which is not of the family that reads it. */
export function attitudeHint(channels: readonly Channel[], ofFamily: string): string {
  const kinds = new Set(channels.map(({ info }) => /^(UBX|NMEA|RTCM3) /.exec(info.group)?.[1]));
  if (kinds.size === 0 || kinds.has(undefined)) return ofFamily;
  return kinds.has("UBX") ? TEXT.ubxAttitude : TEXT.nmeaAttitude;
}
