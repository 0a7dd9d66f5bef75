"""Attitudes and vectors in the axes of ROS, against what a rotation does to a vector."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imuscope.protocols.rotations import quaternions
from imuscope.server.extensions.ros2.axes import body_vectors, enu_from_flu, world_vectors
from tests.support.each_row import each_row

FRAMES = {  # columns: the axes of the frame in ENU
    "ENU": np.eye(3),
    "NED": np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]).T,
    "NWU": np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]).T,
}
BODIES = {"FLU": np.eye(3), "FRD": np.diag([1, -1, -1])}


def matrix(q: np.ndarray) -> np.ndarray:
    """Rotation matrix, from the definition v' = q v q*."""
    w, x, y, z = q
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result: np.ndarray = np.eye(3) + 2 * w * skew + 2 * skew @ skew
    return result


@each_row("frame", FRAMES)
@each_row("axes", BODIES)
def test_attitudes_and_vectors_agree(frame: str, axes: str) -> None:
    source = np.random.default_rng(7)
    q_frame_from_body = Rotation.random(20, source).as_quat(scalar_first=True)
    in_body = source.normal(size=(20, 3))
    result = enu_from_flu(q_frame_from_body, frame, axes)
    for q, expected, vector in zip(result, q_frame_from_body, in_body, strict=True):
        in_frame = matrix(expected) @ vector
        in_enu = world_vectors(in_frame[None], frame)[0]
        assert in_enu == pytest.approx(FRAMES[frame] @ in_frame)
        in_flu = body_vectors(vector[None], axes)[0]
        assert in_flu == pytest.approx(BODIES[axes] @ vector)
        assert matrix(q) @ in_flu == pytest.approx(in_enu)


def test_level_and_north_in_ned_is_a_quarter_turn_in_enu() -> None:
    (q,) = enu_from_flu(quaternions("euler", [np.array([0.0]), np.array([0.0]), np.array([0.0])]), "NED", "FRD")
    assert matrix(q) @ [1, 0, 0] == pytest.approx([0, 1, 0])  # forward is north
    assert matrix(q) @ [0, 0, 1] == pytest.approx([0, 0, 1])  # up is up


@each_row(("kind", "width"), [("euler", 3), ("matrix", 9), ("quaternion", 4)])
def test_attitudes_are_those_of_the_other_views(kind: str, width: int) -> None:
    source = np.random.default_rng(3)
    rows = source.normal(size=(10, width)) * (60 if kind == "euler" else 1)
    if kind != "euler":
        turns = Rotation.random(10, source)
        rows = turns.as_matrix().reshape(10, 9) if kind == "matrix" else turns.as_quat(scalar_first=True)
    expected = {
        "euler": lambda: Rotation.from_euler("ZYX", rows[:, ::-1], degrees=True),
        "matrix": lambda: Rotation.from_matrix(rows.reshape(10, 3, 3)),
        "quaternion": lambda: Rotation.from_quat(rows[:, [1, 2, 3, 0]]),
    }[kind]()
    for q, turned in zip(quaternions(kind, list(rows.T)), expected.as_matrix(), strict=True):
        assert matrix(q) == pytest.approx(turned)


@each_row("kind", ["quaternion", "matrix"])
def test_invalid_attitudes_are_not_numbers(kind: str) -> None:
    width = {"quaternion": 4, "matrix": 9}[kind]
    rows = np.array([np.zeros(width), np.full(width, np.nan), np.full(width, 0.65)])
    if kind == "matrix":
        rows = rows[1:2]
    assert np.isnan(quaternions(kind, list(rows.T))).all()
