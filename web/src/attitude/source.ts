/**
 * From which channel does the attitude come? The first of: the device's own quaternion, its rotation matrix, its Euler angles.
 * An attitude against the earth's axes (ECEF) is the last choice: it needs a position before it says which way is up.
 * A matrix is read through the Euler angles derived from it, so that the order of its elements is known in one place only.
 */
import type { Channel } from "../data/channels";
import { type Matrix3, matrixOfEuler, matrixOfQuaternion, type WorldFrame } from "../data/rotations";
import { nedFromEcef, placeOf, product } from "./ecef";
import { FRAMES } from "./projection";

export interface Source {
  /** "from quaternion", or the message where several carry an attitude: "from INS 1". */
  readonly words: string;
  /** Which quantity of which message it is, in full. */
  readonly detail: string;
  /** The frame the device speaks. */
  readonly frame: WorldFrame;
  /** False: nobody could check who sent it. */
  readonly verified: boolean;
  readonly channel: Channel;
  /** Frame from body at sample `i`; undefined when the sample is no rotation. */
  at(i: number): Matrix3 | undefined;
}

/** The source among the channels of one device; undefined when it sends no attitude. */
export function sourceOf(channels: readonly Channel[]): Source | undefined {
  const own = channels.filter(({ info }) => info.id >= 0);
  const local = own.filter((channel) => !isEarthly(channel));
  const quaternion = local.find(({ info }) => info.kind === "quaternion");
  if (quaternion) return source("from quaternion", quaternion, quaternion, (i) => byQuaternion(quaternion, i));
  const matrix = local.find(({ info }) => info.kind === "matrix");
  const derived = channels.find(({ info }) => info.kind === "euler" && info.id < 0);
  if (matrix && derived) return source("from rotation matrix", matrix, derived, (i) => byEuler(derived, i));
  const euler = local.find(({ info }) => info.kind === "euler") ?? derived;
  if (euler) return source("from Euler angles", euler, euler, (i) => byEuler(euler, i));
  return earthly(own);
}

function source(words: string, from: Channel, channel: Channel, at: Source["at"]): Source {
  const { title, group, frame } = from.info;
  const detail = [group, title || from.info.name, frame].filter(Boolean).join(", ");
  const said = group ? `from ${group}` : words;
  return { words: said, detail, frame: frameOf(from), verified: from.info.verified, channel, at };
}

function isEarthly({ info }: Channel): boolean {
  return info.frame.startsWith("ECEF");
}

/** An attitude against the earth's axes, made level with the position that comes with it; shown as north, east, down. */
function earthly(channels: readonly Channel[]): Source | undefined {
  const attitude = channels.find((channel) => channel.info.kind === "quaternion" && isEarthly(channel));
  if (!attitude) return undefined;
  const positions = channels.filter((channel) => isEarthly(channel) && channel.info.kind === "vector" && channel.info.columns[0]?.unit === "m");
  const position = positions.find(({ info }) => info.message === attitude.info.message) ?? positions[0];
  if (!position) return undefined;
  const at = (i: number): Matrix3 | undefined => {
    const sent = byQuaternion(attitude, i);
    const k = position.ring.indexAt(attitude.ring.time(i), "device");
    const place = k < 0 ? undefined : placeOf([position.ring.value(0, k), position.ring.value(1, k), position.ring.value(2, k)]);
    return sent && place && product(nedFromEcef(place), sent);
  };
  return { ...source("from quaternion", attitude, attitude, at), frame: "NED" };
}

function byQuaternion({ ring }: Channel, i: number): Matrix3 | undefined {
  return finite(matrixOfQuaternion([ring.value(0, i), ring.value(1, i), ring.value(2, i), ring.value(3, i)]));
}

function byEuler({ ring }: Channel, i: number): Matrix3 | undefined {
  return finite(matrixOfEuler([ring.value(0, i), ring.value(1, i), ring.value(2, i)]));
}

/** A device that has no attitude yet sends zeros or NaN. */
function finite(m: Matrix3): Matrix3 | undefined {
  return m.every(Number.isFinite) ? m : undefined;
}

/** "ENU from body" → ENU, which is also what is taken where nothing is said. */
function frameOf(channel: Channel): WorldFrame {
  return FRAMES.find((frame) => channel.info.frame.startsWith(frame)) ?? "ENU";
}
