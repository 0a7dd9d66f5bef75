"""Euler angles agree with the vendor's, and with the rotation they represent."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.rotations import euler_columns
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

VECTORS = json.loads((ROOT / "tests" / "golden" / "xbus" / "orientation.json").read_text())
WITH_ANGLES = [one for one in VECTORS["conversions"] if "euler" in one and one["input"] == "quaternion"]


def angles(q: list[float]) -> list[float]:
    return [float(column[0]) for column in euler_columns([np.array([part]) for part in q])]


@each_row("one", WITH_ANGLES, ids=lambda one: one["what"])
def test_the_vendors_angles(one: dict[str, list[float]]) -> None:
    results = angles(one["values"])
    unit = abs(math.hypot(*one["values"]) - 1) < 1e-6
    if abs(abs(one["euler"][1]) - 90) > 1e-3:
        for got, expected in zip(results, one["euler"], strict=True):
            assert math.remainder(got - expected, 360) == pytest.approx(
                0, abs=2e-4 if unit else 0.05
            )  # the vendor does not norm
    else:
        assert results[1] == pytest.approx(one["euler"][1], abs=1e-3)


def test_the_vectors_are_not_empty() -> None:
    assert len(WITH_ANGLES) >= 5


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: math.hypot(*q) > 0.1))
def test_angles_lead_back_to_the_rotation(q: list[float]) -> None:
    length = math.hypot(*q)
    w, x, y, z = (part / length for part in q)
    roll, pitch, yaw = (math.radians(angle) for angle in angles([w, x, y, z]))
    forward = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    want = (math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch))
    if abs(pitch) < math.radians(89.9):
        assert forward == pytest.approx(want, abs=1e-6)
        assert math.sin(roll) * math.cos(pitch) == pytest.approx(2 * (y * z + w * x), abs=1e-6)
        assert math.cos(roll) * math.cos(pitch) == pytest.approx(1 - 2 * (x * x + y * y), abs=1e-6)


def test_a_matrix_gives_the_angles_of_its_quaternion_and_nan_gives_none() -> None:
    turn = math.radians(30)
    matrix = [math.cos(turn), -math.sin(turn), 0.0, math.sin(turn), math.cos(turn), 0.0, 0.0, 0.0, 1.0]
    results = euler_columns([np.array([part]) for part in matrix])
    assert [float(column[0]) for column in results] == pytest.approx([0, 0, 30])
    assert angles([math.cos(turn / 2), 0, 0, math.sin(turn / 2)]) == pytest.approx([0, 0, 30])
    assert all(math.isnan(angle) for angle in angles([0, 0, 0, 0]))
