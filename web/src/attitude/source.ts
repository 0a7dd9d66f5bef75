/**
 * Selection of the attitude source, the first of: the device's own quaternion, its rotation matrix, its Euler angles. An attitude
 * against the earth's axes (ECEF) comes last: it needs a position to define up. A matrix is read through the Euler angles derived
 * from it, so that only one place depends on the order of its elements.
 */
import type { Channel } from "../data/channels";
import { type Matrix3, matrixOfEuler, matrixOfQuaternion, type WorldFrame } from "../data/rotations";
import { nedFromEcef, geodeticOf, product } from "./ecef";
import { FRAMES } from "./projection";
import { TEXT } from "../texts/attitude";

export interface Source {
  /** "from quaternion", or the message where several carry an attitude: "from INS 1". */
  readonly words: string;
  /** Quantity and message, in full. */
  readonly detail: string;
  /** The frame sent by the device. */
  readonly frame: WorldFrame;
  /** False: the sender could not be verified. */
  readonly verified: boolean;
  readonly channel: Channel;
  /** Frame from body at sample `i`; undefined if the sample is not a rotation. */
  at(i: number): Matrix3 | undefined;
}

/** The source among the channels of one device; undefined when it sends no attitude. */
export function attitudeSource(channels: readonly Channel[]): Source | undefined {
  const own = channels.filter(({ info }) => info.id >= 0);
  const local = own.filter((channel) => !isEarthly(channel));
  const quaternion = local.find(({ info }) => info.kind === "quaternion");
  if (quaternion) return source(TEXT.fromQuaternion, quaternion, quaternion, (i) => byQuaternion(quaternion, i));
  const matrix = local.find(({ info }) => info.kind === "matrix");
  const derived = channels.find(({ info }) => info.kind === "euler" && info.id < 0);
  if (matrix && derived) return source(TEXT.fromRotationMatrix, matrix, derived, (i) => byEuler(derived, i));
  const euler = local.find(({ info }) => info.kind === "euler") ?? derived;
  if (euler) return source(TEXT.fromEulerAngles, euler, euler, (i) => byEuler(euler, i));
  return earthly(own);
}

function source(words: string, from: Channel, channel: Channel, at: Source["at"]): Source {
  const { title, group, frame } = from.info;
  const detail = [group, title || from.info.name, frame].filter(Boolean).join(", ");
  const said = group ? TEXT.fromGroup(group) : words;
  return { words: said, detail, frame: frameOf(from), verified: from.info.verified, channel, at };
}

function isEarthly({ info }: Channel): boolean {
  return info.frame.startsWith("ECEF");
}

/** An attitude against the earth's axes, levelled with the position of the same message; shown as north, east, down. */
function earthly(channels: readonly Channel[]): Source | undefined {
  const attitude = channels.find((channel) => channel.info.kind === "quaternion" && isEarthly(channel));
  if (!attitude) return undefined;
  const positions = channels.filter(
    (channel) => isEarthly(channel) && channel.info.kind === "vector" && channel.info.columns[0]?.unit === "m",
  );
  const position = positions.find(({ info }) => info.message === attitude.info.message) ?? positions[0];
  if (!position) return undefined;
  const at = (i: number): Matrix3 | undefined => {
    const sent = byQuaternion(attitude, i);
    const k = position.ring.indexAt(attitude.ring.time(i), "device");
    const place =
      k < 0 ? undefined : geodeticOf([position.ring.value(0, k), position.ring.value(1, k), position.ring.value(2, k)]);
    return sent && place && product(nedFromEcef(place), sent);
  };
  return { ...source(TEXT.fromQuaternion, attitude, attitude, at), frame: "NED" };
}

function byQuaternion({ ring }: Channel, i: number): Matrix3 | undefined {
  return finite(matrixOfQuaternion([ring.value(0, i), ring.value(1, i), ring.value(2, i), ring.value(3, i)]));
}

function byEuler({ ring }: Channel, i: number): Matrix3 | undefined {
  return finite(matrixOfEuler([ring.value(0, i), ring.value(1, i), ring.value(2, i)]));
}

/** Undefined for zeros or NaN, which a device sends before its first solution. */
function finite(m: Matrix3): Matrix3 | undefined {
  return m.every(Number.isFinite) ? m : undefined;
}

/** "ENU from body" → ENU, which is also the default. */
function frameOf(channel: Channel): WorldFrame {
  return FRAMES.find((frame) => channel.info.frame.startsWith(frame)) ?? "ENU";
}
