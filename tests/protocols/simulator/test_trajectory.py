"""The simulated drive is one consistent motion. What is integrated must come out as what is reported.

Bounds are those of the integration here (1 ms steps, a pothole of 9 ms), not of the motion.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from imuscope.protocols import rotations
from imuscope.protocols.simulator import trajectory

STEP = 1e-3
TIMES = np.arange(0, 2 * trajectory.LAP_S, STEP)


@pytest.fixture(scope="module")
def drive() -> trajectory.MotionState:
    return trajectory.vehicle_motion(TIMES)


def summed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Trapezoids, from 0."""
    return np.concatenate([np.zeros((1, 3)), np.cumsum((values[1:] + values[:-1]) * STEP / 2, axis=0)])


def test_velocity_is_summed_acceleration(drive: trajectory.MotionState) -> None:
    assert np.abs(summed(drive.acceleration) + drive.velocity[0] - drive.velocity).max() < 3e-3


def test_position_is_summed_velocity(drive: trajectory.MotionState) -> None:
    assert np.abs(summed(drive.velocity) + drive.position[0] - drive.position).max() < 1e-4


def test_attitude_is_summed_rate_of_turn(drive: trajectory.MotionState) -> None:
    q = drive.q_enu_from_body_wxyz[0]
    turn = (drive.rate[1:] + drive.rate[:-1]) / 2 * STEP / 2
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    steps = np.concatenate([np.cos(angle), turn * np.sinc(angle / np.pi)], axis=1)
    for i, step in enumerate(steps[: int(trajectory.LAP_S / STEP)]):
        q = rotations.product(q, step)
        if i % 5000 == 0:
            assert abs(abs(q @ drive.q_enu_from_body_wxyz[i + 1]) - 1) < 1e-9
    assert 2 * np.arccos(min(1.0, abs(q @ drive.q_enu_from_body_wxyz[i + 1]))) < 1e-4


def test_specific_force_is_acceleration_less_gravity(drive: trajectory.MotionState) -> None:
    turned = np.einsum("nij,nj->ni", rotations.matrix_of(drive.q_enu_from_body_wxyz), drive.force)
    derived = np.gradient(drive.velocity, STEP, axis=0)
    off = np.abs(turned - derived - [0, 0, trajectory.GRAVITY])[5:-5].max(axis=1)
    hole = np.abs(np.remainder(TIMES[5:-5], trajectory.LAP_S) - trajectory.POTHOLE_S) < 0.1
    assert off[~hole].max() < 0.01
    assert off[hole].max() < 2.0  # 1 ms is coarse for it


def test_at_rest_only_gravity_is_felt() -> None:
    stop = np.arange(trajectory.DRIVE_S + 0.5, trajectory.LEG_S - 0.5, 0.01)
    at_rest = trajectory.vehicle_motion(stop)
    assert trajectory.speed(at_rest).max() < 1e-9
    assert np.abs(at_rest.rate).max() < 1e-6
    assert np.abs(np.linalg.norm(at_rest.force, axis=1) - trajectory.GRAVITY).max() < 0.05  # the engine runs


def test_the_field_keeps_its_size_and_direction(drive: trajectory.MotionState) -> None:
    turned = np.einsum("nij,nj->ni", rotations.matrix_of(drive.q_enu_from_body_wxyz), drive.field)
    assert np.abs(turned - trajectory.FIELD_ENU).max() < 1e-12
    assert abs(np.linalg.norm(trajectory.FIELD_ENU) - 1) < 1e-12


def test_the_trajectory_is_physically_plausible(drive: trajectory.MotionState) -> None:
    assert 5 < trajectory.speed(drive).max() < 20
    assert np.degrees(np.abs(drive.euler[:, :2])).max() < 5
    assert 10 < np.degrees(np.abs(drive.rate)).max() < 60
    assert np.abs(drive.force[:, 2]).max() > 98.07  # the pothole
    assert np.abs(drive.position).max() < 150


def test_euler_angles_are_those_of_the_quaternion(drive: trajectory.MotionState) -> None:
    off = rotations.euler_of(drive.q_enu_from_body_wxyz[::100]) - drive.euler[::100]
    assert np.abs(np.remainder(off + np.pi, 2 * np.pi) - np.pi).max() < 1e-12


@given(st.floats(-1e5, 1e5), st.integers(1, 50))
def test_samples_do_not_depend_on_their_neighbours(begin: float, n: int) -> None:
    times = begin + np.arange(n) * 0.01
    together, alone = trajectory.vehicle_motion(times), trajectory.vehicle_motion(times[-1:])
    for name in ("position", "velocity", "acceleration", "rate", "force"):
        assert np.allclose(getattr(together, name)[-1], getattr(alone, name)[0], rtol=0, atol=1e-9)


def test_geodetic_and_earth_centred_distances_agree(drive: trajectory.MotionState) -> None:
    """ENU, latitude and longitude, and ECEF describe one place: distances are the same to a millimetre in 100 m."""
    some = drive.position[::5000]
    centred = trajectory.ecef(trajectory.geodetic(some))
    assert (
        np.abs(np.linalg.norm(some[1:] - some[0], axis=1) - np.linalg.norm(centred[1:] - centred[0], axis=1)).max()
        < 0.01
    )
    assert np.abs(np.linalg.norm(centred, axis=1) - 6_367_500).max() < 500


def test_errors_repeat_and_have_the_stated_size() -> None:
    rate = 400
    errors = trajectory.SensorErrors(trajectory.GYRO, 5, rate)
    whole = errors.at(0, 40_000)
    assert (np.concatenate([errors.at(0, 333), errors.at(333, 39_667)]) == whole).all()
    assert (trajectory.SensorErrors(trajectory.GYRO, 5, rate).at(1000, 10) == whole[1000:1010]).all()
    assert (trajectory.SensorErrors(trajectory.GYRO, 6, rate).at(1000, 10) != whole[1000:1010]).all()
    noise = whole - errors.bias(np.arange(40_000) / rate)
    assert np.allclose(noise.std(axis=0), trajectory.GYRO.density * np.sqrt(rate / 2), rtol=0.03)
    assert np.abs(errors.bias(np.arange(0, 3600, 1.0))).max() < 6 * trajectory.GYRO.bias
