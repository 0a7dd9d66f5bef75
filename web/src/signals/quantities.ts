/**
 * One language of quantities: words for the same thing, so that a search finds it in all devices, however each of them and its makers
 * call it: "gyro z", "angular velocity", "pqr[2]" and "rate of turn z" are one signal. Pure.
 */
import type { ChannelInfo } from "../wire/types";

interface Quantity {
  /** Titles and names of channels. */
  readonly is: RegExp;
  readonly words: string;
  /** Letters of its axes besides x, y, z. */
  readonly axes?: string;
}

const QUANTITIES: readonly Quantity[] = [
  {
    is: /rate.?of.?turn|angular.?(rate|velocity)|gyro|\bpqr\b/i,
    words: "rate of turn, turn rate, angular velocity, angular rate, gyro, gyroscope, pqr, omega",
    axes: "pqr",
  },
  { is: /^(?!.*free).*\bacc(el|eleration)?\b/i, words: "acceleration, accelerometer, accel, acc, specific force" },
  { is: /free.?acc/i, words: "free acceleration, linear acceleration" },
  { is: /^(?!.*(vel|acc)).*\bmag(netic|netometer)?\b/i, words: "magnetic field, magnetometer, mag, compass" },
  { is: /euler|roll.*pitch|\btheta\b/i, words: "attitude, orientation, euler angles, roll, pitch, yaw, heading, rpy" },
  { is: /quat|\bqn2b\b|\bqe2b\b/i, words: "quaternion, attitude, orientation, quat" },
  { is: /velocity|\buvw\b|speed/i, words: "velocity, speed, vel, uvw", axes: "uvw" },
  { is: /position|\blla\b|lat.*lon|ecef/i, words: "position, latitude, longitude, altitude, lat, lon, lla, gnss, gps" },
  { is: /temp/i, words: "temperature, temp" },
  { is: /press|baro/i, words: "pressure, barometer, baro" },
];

/** Words by which a channel is found besides its own. */
export function quantityWords({ name, title }: Pick<ChannelInfo, "name" | "title">): string {
  const own = `${name} ${title}`.replace(/([a-z])([A-Z])/g, "$1 $2");
  return QUANTITIES.filter(({ is }) => is.test(own))
    .map(({ words }) => words)
    .join(", ");
}

/** Words by which a column is found besides its own: "[2]", and "r" of a rate of turn. */
export function columnWords(channel: Pick<ChannelInfo, "name" | "title">, column: string, at: number): string {
  const place = "xyz".indexOf(column);
  const own = `${channel.name} ${channel.title}`;
  const letters = place < 0 ? [] : QUANTITIES.flatMap(({ is, axes }) => (axes && is.test(own) ? [axes[place]] : []));
  return [`[${place < 0 ? at : place}]`, ...letters].join(" ");
}

/** The words of a search; an index is one of its own: "pqr[2]" is "pqr" and "[2]". */
export const searchWords = (search: string): readonly string[] =>
  search.toLowerCase().replace(/\[/g, " [").split(/\s+/).filter(Boolean);
