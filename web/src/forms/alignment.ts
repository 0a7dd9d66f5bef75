/**
 * Turn of a sensor by its alignment. Pure.
 *
 * A rotation "A from B" turns a vector given in B into one given in A. It is stored as the quaternion that does so, scalar first,
 * or as the angles (about z, then y, then x) that turn the axes of B into those of A, which is the inverse matrix.
 */
import {
  eulerOfMatrix,
  matrixOfEuler,
  matrixOfQuaternion,
  type Matrix3,
  type Quaternion,
  quaternionOfEuler,
  type Vector3,
} from "../data/rotations";
import type { FieldForm } from "../wire/form-types";

/** Elements of a quaternion that are fields of their own; empty if there is none among these fields. */
export function quaternionOf(fields: readonly FieldForm[]): readonly FieldForm[] {
  const found = fields.filter(({ frame, editor }) => frame.includes(" from ") && editor === "number");
  return found.length === 4 ? found : [];
}

/** Whether a field has the three angles of a rotation. */
export const hasAngles = ({ frame, editor, axes }: FieldForm): boolean =>
  frame.includes(" from ") && editor === "vector" && axes.join() === "roll,pitch,yaw";

export interface Turn {
  /** Roll, pitch, yaw, °. */
  readonly angles: Vector3;
  /** A from B: its columns are the axes of the sensor. */
  readonly matrix: Matrix3;
}

/** Turn of stored elements, in displayed units: four of a quaternion, three angles; undefined if they are no rotation. */
export function turnOf(elements: readonly unknown[]): Turn | undefined {
  if (!elements.every((one): one is number => typeof one === "number")) return undefined;
  if (elements.length === 3) {
    const angles = elements as unknown as Vector3;
    const [a, b, c, d, e, f, g, h, i] = matrixOfEuler(angles);
    return { angles, matrix: [a, d, g, b, e, h, c, f, i] };
  }
  const matrix = matrixOfQuaternion(elements as unknown as Quaternion);
  return Number.isNaN(matrix[0]) ? undefined : { angles: eulerOfMatrix(matrix), matrix };
}

/** Elements to store, for angles in °. */
export const elementsOf = (angles: Vector3, count: number): readonly number[] =>
  count === 3 ? angles : quaternionOfEuler(angles);

export const isUpsideDown = ({ matrix }: Turn): boolean => matrix[8] < 0;

/** The same turn after half a turn about the sensor's own x axis. */
export function turnedOver([roll, pitch, yaw]: Vector3): Vector3 {
  return [roll > 0 ? roll - 180 : roll + 180, pitch, yaw];
}
