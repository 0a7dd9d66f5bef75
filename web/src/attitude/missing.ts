import type { Channel } from "../data/channels";
import { embeddedKinds } from "../wire/capabilities";
import { TEXT } from "../texts/attitude";

/** What gives an attitude: the hint of the family, but for a receiver alone (UBX, NMEA), which is not of the family that reads it. */
export function attitudeHint(channels: readonly Channel[], ofFamily: string): string {
  const kinds = embeddedKinds(channels.map(({ info }) => info));
  if (kinds.size === 0) return ofFamily;
  return kinds.has("UBX") ? TEXT.ubxAttitude : TEXT.nmeaAttitude;
}
