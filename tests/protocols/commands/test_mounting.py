"""Mounting rotations as the devices store them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.isb.family import FAMILY as ISB
from imuscope.protocols.isb.family import frame_angles
from imuscope.protocols.rotations import matrix_of, quaternion_of
from imuscope.protocols.xbus.family import FAMILY as XBUS

PARTS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@given(PARTS)
def test_a_matrix_and_its_quaternion_are_the_same_rotation(parts: tuple[float, ...]) -> None:
    matrix = matrix_of(np.array(parts))
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)
    assert matrix_of(quaternion_of(matrix)) == pytest.approx(matrix, abs=1e-9)
    assert XBUS.configuration.mounting is not None
    assert float(str(XBUS.configuration.mounting.values(matrix, {})["q0"])) >= 0


@given(PARTS)
def test_angles_turn_the_frame_about_z_then_y_then_x(parts: tuple[float, ...]) -> None:
    matrix = matrix_of(np.array(parts))
    roll, pitch, yaw = frame_angles(matrix)

    def about(axis: int, angle: float) -> np.ndarray:
        """What a vector is in a frame that is turned."""
        i, j = (axis + 1) % 3, (axis + 2) % 3
        rows = np.eye(3)
        rows[i, i] = rows[j, j] = np.cos(angle)
        rows[i, j], rows[j, i] = np.sin(angle), -np.sin(angle)
        return rows

    assert about(0, roll) @ about(1, pitch) @ about(2, yaw) == pytest.approx(matrix, abs=3e-6)


@given(PARTS, PARTS)
def test_an_mti_that_turns_its_vectors_already_adds_the_rotation(
    result: tuple[float, ...], stored: tuple[float, ...]
) -> None:
    assert XBUS.configuration.mounting is not None
    before, added = matrix_of(np.array(stored)), matrix_of(np.array(result))
    q = np.array(stored) / np.linalg.norm(stored)
    values = XBUS.configuration.mounting.values(added, dict(zip(("q0", "q1", "q2", "q3"), q.tolist(), strict=True)))
    vector = np.array([0.3, -0.5, 0.8])
    written = matrix_of(np.array([values[name] for name in ("q0", "q1", "q2", "q3")]))
    assert written @ vector == pytest.approx(added @ before @ vector, abs=1e-9)


def test_an_imx_takes_angles_in_place_of_the_stored_ones() -> None:
    assert ISB.configuration.mounting is not None
    # its z axis is the y axis of the vehicle: a quarter turn of the frame about x
    quarter = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    values = ISB.configuration.mounting.values(quarter, {"insRotation": [1.0, 2.0, 3.0]})
    assert values == {"insRotation": pytest.approx([np.pi / 2, 0, 0])}
