"""Vectors and attitudes of a device in the axes of ROS (REP 103, REP 145), many at once. Pure.

    world     ENU: x east, y north, z up                                    of devices: ENU, NED, NWU
    body      FLU: x forward, y left, z up                                  of devices: FLU, FRD (y right, z down)

    q_enu_from_flu = q_enu_from_frame ⊗ q_frame_from_body ⊗ q_body_from_flu       scalar first

At rest and level a device reports an acceleration of +g upwards: z is +9.81 in FLU, −9.81 in FRD.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import ENU_FROM, Quaternion, product

FLIP = np.array([1.0, -1.0, -1.0])  # FRD and FLU: half a turn about x
FLU_FROM: Mapping[str, Floats] = {"FLU": np.ones(3), "FRD": FLIP}
_BODY_FROM_FLU: Mapping[str, Quaternion] = {"FLU": (1.0, 0.0, 0.0, 0.0), "FRD": (0.0, 1.0, 0.0, 0.0)}
_ENU_ROWS: Mapping[str, tuple[Sequence[int], Sequence[float]]] = {  # which component of the frame, and its sign
    "ENU": ((0, 1, 2), (1.0, 1.0, 1.0)),
    "NED": ((1, 0, 2), (1.0, 1.0, -1.0)),
    "NWU": ((1, 0, 2), (-1.0, 1.0, 1.0)),
}


def body_vectors(vectors: Floats, axes: str) -> Floats:
    """Vectors (n, 3) in body axes, as FLU."""
    return vectors * FLU_FROM[axes]


def world_vectors(vectors: Floats, frame: str) -> Floats:
    """Vectors (n, 3) in ENU, NED or NWU, as ENU."""
    order, signs = _ENU_ROWS[frame]
    turned: Floats = vectors[:, order] * np.array(signs)
    return turned


def enu_from_flu(quaternions: Floats, frame: str, axes: str) -> Floats:
    """Quaternions (n, 4) of the body in a frame, as those of FLU in ENU."""
    return product(product(np.array(ENU_FROM[frame]), quaternions), np.array(_BODY_FROM_FLU[axes]))
