"""Files of a device at a known attitude: nose 12° up, right side 20° down, heading 70°.

Written by the textbook in the form that each message has: angles in NED, quaternions from body to NED, to ENU, to the
earth's axes.
"""

import math
import struct
from collections.abc import Callable

import numpy as np

from imuscope.protocols.idtp.frames import build as idtp_frame
from imuscope.protocols.isb.frames import DATA
from imuscope.protocols.isb.frames import build as isb_frame

HEADING, NOSE_UP, RIGHT_DOWN = 70.0, 12.0, 20.0
PLACE = (52.22, 6.89)
FRAMES = 600
WEEK, TOW_S = 2445, 100_000.0


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Scalar first, of angles in ° turned in the order yaw, pitch, roll."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in np.radians([roll, pitch, yaw]) / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def product(p: tuple[float, ...], q: tuple[float, ...]) -> tuple[float, ...]:
    """P ⊗ q."""
    (a, b, c, d), (e, f, g, h) = p, q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


NED = quaternion(RIGHT_DOWN, NOSE_UP, HEADING)
"""Body forward, right, down."""
ENU = quaternion(RIGHT_DOWN, -NOSE_UP, 90 - HEADING)
"""Body forward, left, up: positive pitch is nose down."""
# The earth's axes turned by the longitude about z, then by 90° and the latitude about −y, are north, east, down.
ECEF = product(product(quaternion(0, 0, PLACE[1]), quaternion(0, -90 - PLACE[0], 0)), NED)


def ecef_position() -> tuple[float, float, float]:
    """Position of PLACE at height 0."""
    lat, lon = np.radians(PLACE)
    e2 = 0.0066943799901413165
    n = 6378137.0 / math.sqrt(1 - e2 * math.sin(lat) ** 2)
    return n * math.cos(lat) * math.cos(lon), n * math.cos(lat) * math.sin(lon), n * (1 - e2) * math.sin(lat)


def ins(did: int, *tail: bytes) -> bytes:
    """A file of one INS message at 100 Hz."""
    out = b""
    for k in range(FRAMES):
        head = struct.pack("<IdII", WEEK, TOW_S + k / 100, 0x0008_0000 | 3 << 16, 0)
        out += isb_frame(DATA, did, head + b"".join(tail))
    return out


def ins_1() -> bytes:
    angles = struct.pack("<3f", *np.radians([RIGHT_DOWN, NOSE_UP, HEADING]))
    return ins(4, angles, struct.pack("<3f", 1, 0, 0), struct.pack("<3d", *PLACE, 60), struct.pack("<3f", 0, 0, 0))


def ins_2() -> bytes:
    return ins(5, struct.pack("<4f", *NED), struct.pack("<3f", 1, 0, 0), struct.pack("<3d", *PLACE, 60))


def ins_4() -> bytes:
    return ins(66, struct.pack("<4f", *ECEF), struct.pack("<3f", 0, 0, 0), struct.pack("<3d", *ecef_position()))


def imu_quat() -> bytes:
    payload = struct.pack("<4f", *ENU)
    return b"".join(
        idtp_frame(6, payload, sequence=k + 1, timestamp=10_000 * k, mode=1, device=7) for k in range(FRAMES)
    )


MAKERS: dict[str, Callable[[], bytes]] = {"ins-1": ins_1, "ins-2": ins_2, "ins-4": ins_4, "imu-quat": imu_quat}
