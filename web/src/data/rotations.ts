/**
 * Derived rotations: Euler angles from a quaternion or a rotation matrix, the same rotation or vector in another world frame,
 * and the length of a vector. Pure functions over columns, independent of channels and rings.
 *
 * World frames name the same three directions differently:
 *
 *     ENU   x east    y north   z up          NED = (y, x, −z) of ENU
 *     NED   x north   y east    z down        NWU = (y, −x, z) of ENU
 *     NWU   x north   y west    z up
 *
 * A rotation is "frame from body": v_frame = R v_body, quaternions scalar first. Changing the frame rotates from the left,
 * q_b = q_(b from a) ⊗ q_a; the body axes stay. Euler angles are ZYX intrinsic (yaw, then pitch, then roll):
 * R = Rz(yaw) Ry(pitch) Rx(roll), angles in °. Within GIMBAL of pitch ±90° roll is set to 0 and yaw takes the rest.
 *
 * Source: MT low-level protocol MT0101P 2020.A, sections 8.5 and 8.6 (a rotation matrix is sent column by column; the decoder
 * transposes it, so it is row by row here); checked against the vendor's own results in tests/golden/xbus/orientation.json.
 */

export type WorldFrame = "ENU" | "NED" | "NWU";
export type Vector3 = readonly [number, number, number];
export type Quaternion = readonly [number, number, number, number];
/** Row by row: m[3 * row + column]. */
export type Matrix3 = readonly [number, number, number, number, number, number, number, number, number];

/** Any column of numbers. */
export type Numbers = ArrayLike<number>;

const DEGREE = Math.PI / 180;
/** Of a norm: float32 and slow filters stay far below; beyond it an attitude is off by a degree. */
const UNIT_TOLERANCE = 0.01;
/** Half a thousandth of a degree: nearer to ±90° than this, float32 elements say nothing about roll and yaw apart. */
const GIMBAL = 1 - 1e-11;
const HALF = Math.SQRT1_2;

/** `to` from `from`, as a quaternion. */
export const BETWEEN: Readonly<Record<WorldFrame, Readonly<Record<WorldFrame, Quaternion>>>> = {
  ENU: { ENU: [1, 0, 0, 0], NED: [0, HALF, HALF, 0], NWU: [HALF, 0, 0, -HALF] },
  NED: { ENU: [0, HALF, HALF, 0], NED: [1, 0, 0, 0], NWU: [0, 1, 0, 0] },
  NWU: { ENU: [HALF, 0, 0, HALF], NED: [0, 1, 0, 0], NWU: [1, 0, 0, 0] },
};

/** a ⊗ b: rotation by b, then by a. */
export function multiply(a: Quaternion, b: Quaternion): Quaternion {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
  ];
}

/** A vector given in the axes of `from`, in those of `to`: swaps and signs only, so exact. */
export function vectorIn(v: Vector3, from: WorldFrame, to: WorldFrame): Vector3 {
  const [x, y, z] = v;
  switch (`${from} ${to}` as const) {
    case "ENU NED":
    case "NED ENU":
      return [y, x, -z];
    case "ENU NWU":
      return [y, -x, z];
    case "NWU ENU":
      return [-y, x, z];
    case "NED NWU":
    case "NWU NED":
      return [x, -y, -z];
    case "ENU ENU":
    case "NED NED":
    case "NWU NWU":
      return v;
  }
}

/** Frame from body as a matrix; NaN throughout for a quaternion whose norm is not 1. */
export function matrixOfQuaternion([w, x, y, z]: Quaternion): Matrix3 {
  const squares = w * w + x * x + y * y + z * z;
  const s = Math.abs(Math.sqrt(squares) - 1) <= UNIT_TOLERANCE ? 2 / squares : NaN;
  return [
    1 - s * (y * y + z * z),
    s * (x * y - w * z),
    s * (x * z + w * y),
    s * (x * y + w * z),
    1 - s * (x * x + z * z),
    s * (y * z - w * x),
    s * (x * z - w * y),
    s * (y * z + w * x),
    1 - s * (x * x + y * y),
  ];
}

/** Frame from body of roll, pitch, yaw in °. */
export function matrixOfEuler([roll, pitch, yaw]: Vector3): Matrix3 {
  const [cr, sr, cp, sp] = [
    Math.cos(roll * DEGREE),
    Math.sin(roll * DEGREE),
    Math.cos(pitch * DEGREE),
    Math.sin(pitch * DEGREE),
  ];
  const [cy, sy] = [Math.cos(yaw * DEGREE), Math.sin(yaw * DEGREE)];
  return [
    cy * cp,
    cy * sp * sr - sy * cr,
    cy * sp * cr + sy * sr,
    sy * cp,
    sy * sp * sr + cy * cr,
    sy * sp * cr - cy * sr,
    -sp,
    cp * sr,
    cp * cr,
  ];
}

/** Quaternion of roll, pitch, yaw in °, with a scalar of 0 or more. */
export function quaternionOfEuler(angles: Vector3): Quaternion {
  const [r, p, y] = angles.map((angle) => [Math.cos((angle * DEGREE) / 2), Math.sin((angle * DEGREE) / 2)] as const);
  if (!r || !p || !y) return [1, 0, 0, 0];
  const q = multiply(multiply([y[0], 0, 0, y[1]], [p[0], 0, p[1], 0]), [r[0], r[1], 0, 0]);
  const sign = q[0] < 0 ? -1 : 1;
  return q.map((one) => (Math.abs(one) < 1e-15 ? 0 : one * sign)) as unknown as Quaternion;
}

/** The same rotation with the world's axes renamed: the rows move as a vector does. */
export function matrixIn(m: Matrix3, from: WorldFrame, to: WorldFrame): Matrix3 {
  const column = (c: 0 | 1 | 2): Vector3 => vectorIn([m[c], m[(3 + c) as 3], m[(6 + c) as 6]], from, to);
  const [a, b, c] = [column(0), column(1), column(2)];
  return [a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]];
}

/** Roll and yaw in (−180, 180], pitch in [−90, 90], °. */
export function eulerOfMatrix(m: Matrix3): Vector3 {
  const down = -m[6];
  const pitch = Math.asin(Math.min(1, Math.max(-1, down))) / DEGREE;
  if (Math.abs(down) > GIMBAL) return [0, pitch, Math.atan2(-m[1], m[4]) / DEGREE];
  return [Math.atan2(m[7], m[8]) / DEGREE, pitch, Math.atan2(m[3], m[0]) / DEGREE];
}

/**
 * Roll, pitch and yaw of n rotations.
 *
 * @param columns 4 columns (w, x, y, z), or 9: the elements of the matrix row by row (m00, m01 … m22), as the server shows them
 * @returns three columns of n values, °
 */
export function eulerColumns(columns: readonly Numbers[], n: number): [Float64Array, Float64Array, Float64Array] {
  const out: [Float64Array, Float64Array, Float64Array] = [
    new Float64Array(n),
    new Float64Array(n),
    new Float64Array(n),
  ];
  const at = (c: number, i: number): number => columns[c]?.[i] ?? NaN;
  for (let i = 0; i < n; i++) {
    const m: Matrix3 =
      columns.length >= 9
        ? [at(0, i), at(1, i), at(2, i), at(3, i), at(4, i), at(5, i), at(6, i), at(7, i), at(8, i)]
        : matrixOfQuaternion([at(0, i), at(1, i), at(2, i), at(3, i)]);
    [out[0][i], out[1][i], out[2][i]] = eulerOfMatrix(m);
  }
  return out;
}

/** Length of n vectors given as columns, in the unit of the columns. */
export function normColumn(columns: readonly Numbers[], n: number): Float32Array {
  const out = new Float32Array(n);
  for (let i = 0; i < n; i++) {
    let sum = 0;
    for (const column of columns) sum += column[i]! * column[i]!;
    out[i] = Math.sqrt(sum);
  }
  return out;
}

/**
 * Bounds of the lengths of an interval's vectors. Rows come in pairs: the least and the greatest of each component. The corner
 * nearest to zero and the one farthest from it bound every vector within; the pair is those two lengths.
 */
export function normBounds(columns: readonly Numbers[], n: number): Float32Array {
  const out = new Float32Array(n);
  for (let i = 0; i + 1 < n; i += 2) {
    let [near, far] = [0, 0];
    for (const column of columns) {
      const [lo, hi] = [column[i]!, column[i + 1]!];
      const least = lo > 0 ? lo : hi < 0 ? -hi : 0;
      const most = Math.max(Math.abs(lo), Math.abs(hi));
      near += lo === lo ? least * least : NaN;
      far += most * most;
    }
    [out[i], out[i + 1]] = [Math.sqrt(near), Math.sqrt(far)];
  }
  return out;
}
