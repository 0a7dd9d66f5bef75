/**
 * From which channel does the attitude come? The first of: the device's own quaternion, its rotation matrix, its Euler angles.
 * A matrix is read through the Euler angles derived from it, so that the order of its elements is known in one place only.
 */
import type { Channel } from "../data/store";
import { type Matrix3, matrixOfEuler, matrixOfQuaternion, type WorldFrame } from "../data/derive";
import { FRAMES } from "./maths";

export interface Source {
  readonly words: "from quaternion" | "from rotation matrix" | "from Euler angles";
  /** The frame the device speaks. */
  readonly frame: WorldFrame;
  readonly channel: Channel;
  /** Frame from body at sample `i`; undefined when the sample is no rotation. */
  at(i: number): Matrix3 | undefined;
}

/** The source among the channels of one device; undefined when it sends no attitude. */
export function sourceOf(channels: readonly Channel[]): Source | undefined {
  const own = (kind: string): Channel | undefined => channels.find(({ info }) => info.kind === kind && info.id >= 0);
  const quaternion = own("quaternion");
  if (quaternion) return { words: "from quaternion", frame: frameOf(quaternion), channel: quaternion, at: (i) => byQuaternion(quaternion, i) };
  const matrix = own("matrix");
  const derived = channels.find(({ info }) => info.kind === "euler" && info.id < 0);
  if (matrix && derived) {
    return { words: "from rotation matrix", frame: frameOf(matrix), channel: derived, at: (i) => byEuler(derived, i) };
  }
  const euler = own("euler") ?? derived;
  if (euler) return { words: "from Euler angles", frame: frameOf(euler), channel: euler, at: (i) => byEuler(euler, i) };
  return undefined;
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
