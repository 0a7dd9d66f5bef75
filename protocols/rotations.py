"""Rotation mathematics: quaternions, matrices and Euler angles of attitudes. The only place that has any.

    R = Rz(yaw) Ry(pitch) Rx(roll)     frame from body, angles in °, yaw first; near pitch ±90° (`GIMBAL_SINE`) roll
                                       is 0 and yaw takes the rest; a quaternion without length has no angles (NaN)

    q_enu_from_body = q_enu_from_frame ⊗ q_frame_from_body        frame: ENU, NED or NWU; scalar first

ENU: x east, y north, z up. Live, the page computes Euler angles for every sample. Of a recording it sees summaries, and
the least and greatest quaternion component define no angle; so the angles are computed sample by sample when a
recording is opened, and exports have them too.

scipy's Rotation is not used: it refuses a quaternion without length, which devices send before their first solution,
and a product of 1 or 1000 rotations takes it 37 or 864 µs, beside 14 or 39 µs here (0.5 µs of a few numbers, for the
scene, which turns its objects one by one).

Source: MT low-level protocol MT0101P 2020.A, sections 8.5 and 8.6; the page's web/src/data/rotations.ts does the same.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from imuscope.protocols.arrays import Array, Floats

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
Part = TypeVar("Part", float, Floats)

GIMBAL_SINE = 1 - 1e-11
UNIT_TOLERANCE = 0.01  # of the norm: float32 and slow filters stay far below; beyond it an attitude is off by a degree

_HALF = math.sqrt(0.5)
ENU_FROM: Mapping[str, Quaternion] = {
    "ENU": (1.0, 0.0, 0.0, 0.0),
    "NED": (0.0, _HALF, _HALF, 0.0),
    "NWU": (_HALF, 0.0, 0.0, _HALF),
}


# -- columns: one array for each component -----------------------------------------------------------------------------


def euler_columns(columns: Sequence[Array]) -> list[Floats]:
    """Roll, pitch and yaw of n rotations.

    Args:
        columns: 4 of (n,): w, x, y, z; or 9: the matrix row by row.

    Returns:
        three columns (n,), °: roll and yaw in (−180, 180], pitch in [−90, 90]; NaN where a quaternion has not norm 1.
    """
    parts = [np.asarray(column, np.float64) for column in columns]
    with np.errstate(all="ignore"):
        m = parts if len(parts) == 9 else _matrix(*parts)
        down = -m[6]
        if len(parts) == 4:
            norm = np.sqrt(sum(part * part for part in parts))
            down = np.where(np.abs(norm - 1) <= UNIT_TOLERANCE, down, np.nan)
        pitch = np.degrees(np.arcsin(np.clip(down, -1.0, 1.0)))
        locked = np.abs(down) > GIMBAL_SINE
        roll = np.where(locked, 0.0, np.degrees(np.arctan2(m[7], m[8])))
        yaw = np.degrees(np.where(locked, np.arctan2(-m[1], m[4]), np.arctan2(m[3], m[0])))
    return [np.where(np.isnan(pitch), np.nan, angle) for angle in (roll, pitch, yaw)]


def quaternion_columns(columns: Sequence[Array]) -> list[Floats]:
    """Quaternions of n rotations given as Euler angles.

    Args:
        columns: roll, pitch and yaw, (n,) °.

    Returns:
        w, x, y, z: (n,) each, of unit norm.
    """
    half = [np.radians(np.asarray(column, np.float64)) / 2 for column in columns]
    (cr, cp, cy), (sr, sp, sy) = [np.cos(angle) for angle in half], [np.sin(angle) for angle in half]
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def quaternions(kind: str, columns: Sequence[Array]) -> Floats:
    """Unit quaternions, (n, 4), of an attitude channel; a row of NaN where it is invalid (NaN, a norm that is not 1).

    Args:
        kind: "quaternion", "matrix" (row by row) or "euler" (roll, pitch, yaw in °).
        columns: of the channel, (n,) each.
    """
    if kind == "euler":
        return side_by_side(*quaternion_columns(columns))
    values = np.column_stack(columns).astype(np.float64)
    if kind == "matrix":
        return quaternion_of(values.reshape(-1, 3, 3))
    lengths = np.linalg.norm(values, axis=1, keepdims=True)
    return np.where(np.abs(lengths - 1) <= UNIT_TOLERANCE, values / np.where(lengths > 0, lengths, 1.0), np.nan)


def _matrix(w: Floats, x: Floats, y: Floats, z: Floats) -> list[Floats]:
    s = 2 / (w * w + x * x + y * y + z * z)
    return [
        *(1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        *(s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)),
        *(s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)),
    ]


# -- rows: quaternions (n, 4), or one, (4,) ----------------------------------------------------------------------------


def multiply(
    p: tuple[Part, Part, Part, Part] | Sequence[Part], q: tuple[Part, Part, Part, Part] | Sequence[Part]
) -> tuple[Part, Part, Part, Part]:
    """Components of p ⊗ q, the rotation by q, then by p: of numbers, or of columns (n,)."""
    (a, b, c, d), (e, f, g, h) = p, q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def product(p: Array, q: Array) -> Floats:
    """Hamilton product, (n, 4); either may be one quaternion, (4,)."""
    return side_by_side(*multiply(list(np.asarray(p, np.float64).T), list(np.asarray(q, np.float64).T)))


def conjugate(q: Floats) -> Floats:
    """The inverse of unit quaternions."""
    result: Floats = q * np.array([1.0, -1.0, -1.0, -1.0])
    return result


def euler_of(q: Array) -> Floats:
    """Roll, pitch and yaw, (n, 3) rad, of quaternions."""
    return np.radians(side_by_side(*euler_columns(list(np.asarray(q).T))))


def of_euler(angles: Array) -> Floats:
    """Unit quaternions of roll, pitch and yaw, (n, 3) rad."""
    return side_by_side(*quaternion_columns(list(np.degrees(angles).T)))


def matrix_of(q: Array) -> Floats:
    """Rotation matrices, (n, 3, 3), of quaternions of any length."""
    return side_by_side(*_matrix(*np.asarray(q, np.float64).T)).reshape(*np.shape(q)[:-1], 3, 3)


def quaternion_of(matrix: Floats) -> Floats:
    """Unit quaternions of rotation matrices (n, 3, 3), or of one; NaN where one is not finite.

    Computed from the largest of the four components, which is positive, so that no square root vanishes.
    """
    m = matrix.reshape(-1, 9).T
    x, y, z = m[7] - m[5], m[2] - m[6], m[3] - m[1]
    xy, yz, zx = m[1] + m[3], m[5] + m[7], m[2] + m[6]
    w = 1 + m[0] + m[4] + m[8]
    form = np.array(
        [
            [w, x, y, z],
            [x, 1 + m[0] - m[4] - m[8], xy, zx],
            [y, xy, 1 - m[0] + m[4] - m[8], yz],
            [z, zx, yz, 1 - m[0] - m[4] + m[8]],
        ]
    )
    largest = np.argmax(np.einsum("iin->in", form), axis=0)
    rows = form[largest, :, np.arange(m.shape[1])]
    with np.errstate(invalid="ignore"):
        rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    finite = np.isfinite(m.sum(axis=0, keepdims=True)).T
    return np.where(finite, rows, np.nan).reshape(*matrix.shape[:-2], 4)


def to_body(q_frame_from_body: Array, v: Array) -> Floats:
    """Vectors, (n, 3), from the frame into the body."""
    return np.asarray(np.einsum("nji,nj->ni", matrix_of(q_frame_from_body), v))


def angle_of(q: Floats) -> Floats:
    """Angle of rotation, °, 0 to 180."""
    result: Floats = np.degrees(2 * np.arctan2(np.linalg.norm(q[..., 1:], axis=-1), np.abs(q[..., 0])))
    return result


def slerp(p: Floats, q: Floats, part: Floats) -> Floats:
    """Rotations between p and q by the shorter way, at a constant rate."""
    dot = np.sum(p * q, axis=-1)
    q = np.where(dot[..., np.newaxis] < 0, -q, q)
    half = np.arccos(np.clip(np.abs(dot), 0, 1))
    sine = np.sin(half)
    flat = sine < 1e-6
    safe = np.where(flat, 1.0, sine)
    first = np.where(flat, 1 - part, np.sin((1 - part) * half) / safe)
    second = np.where(flat, part, np.sin(part * half) / safe)
    result = first[..., np.newaxis] * p + second[..., np.newaxis] * q
    return np.asarray(result / np.linalg.norm(result, axis=-1, keepdims=True))


def mean_rotation(q: Floats) -> Floats:
    """The rotation with the least sum of squared distances: q and −q count as the same (Markley et al., 2007)."""
    _, vectors = np.linalg.eigh(q.T @ q)
    result: Floats = vectors[:, -1]
    return result


def from_x(v: Vector) -> Quaternion:
    """A rotation that brings +x to the direction of `v`, whose length is not 0."""
    x, y, z = (one / math.hypot(*v) for one in v)
    if x < -0.999999:
        return (0.0, 0.0, 0.0, 1.0)
    length = math.hypot(1 + x, y, z)
    return ((1 + x) / length, 0.0, -z / length, y / length)


def side_by_side(*columns: Floats) -> Floats:
    """Columns side by side on the last axis: np.stack, which takes longer than the arithmetic on a few samples."""
    stacked = np.empty((*columns[0].shape, len(columns)))
    for i, column in enumerate(columns):
        stacked[..., i] = column
    return stacked
