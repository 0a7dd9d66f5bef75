"""Comparison of devices with different axes: FLU against FRD, ENU against NED; known motion, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imuscope.protocols.arrays import Floats
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.rotations import ENU_FROM, conjugate, euler_columns, product
from imuscope.protocols.simulator.trajectory import MotionState, vehicle_motion
from imuscope.server.extensions.analysis.compare.two_sides import (
    ComparisonAnswer,
    ComparisonOptions,
    ComparisonSide,
    compared,
)
from imuscope.server.extensions.analysis.expressions.signal_request import requested_signals, unknown_product
from imuscope.server.wire import ChannelInfo, ColumnInfo
from tests.support.each_row import each_row

TIME = np.arange(0, 30, 0.02)
MOTION: MotionState = vehicle_motion(TIME)
HALF_TURN = np.array([0.0, 1.0, 0.0, 0.0])
Q_NED = product(product(conjugate(np.array(ENU_FROM["NED"])), MOTION.q_enu_from_body_wxyz), HALF_TURN)
FLU: dict[str, tuple[str, str, str, Floats]] = {
    "acc": ("vector", "", "m/s²", MOTION.force),
    "vel": ("vector", "ENU", "m/s", MOTION.velocity),
    "q": ("quaternion", "ENU from body", "", MOTION.q_enu_from_body_wxyz),
    "euler": ("euler", "ENU from body", "°", np.stack(euler_columns(list(MOTION.q_enu_from_body_wxyz.T)), 1)),
}
FRD: dict[str, tuple[str, str, str, Floats]] = {
    "acc": ("vector", "body", "m/s²", MOTION.force * (1, -1, -1)),
    "vel": ("vector", "NED", "m/s", MOTION.velocity[:, [1, 0, 2]] * (1, 1, -1)),
    "q": ("quaternion", "NED from body", "", Q_NED),
    "euler": ("euler", "NED from body", "°", np.stack(euler_columns(list(Q_NED.T)), 1)),
}


def side(axes: Any, name: str) -> ComparisonSide:
    table = FRD if axes == "FRD" else FLU
    channel = name.partition(".")[0].removeprefix("norm(").removesuffix(")")
    kind, frame, unit, values = table[channel]
    names = {"quaternion": "wxyz", "euler": "xyz", "vector": "xyz"}[kind]
    columns = [
        ColumnInfo(name=one, dtype="f8", axis=one, unit=unit, period=360.0 if unit == "°" else 0.0)  # type: ignore[arg-type]
        for one in names
    ]
    fields: dict[str, Any] = {"id": 1, "device": "1", "name": channel, "title": channel, "kind": kind}
    info = ChannelInfo(**fields, message="M", unit=unit, frame=frame, columns=columns)

    def product_of(device: str) -> tuple[str, SensorProperties]:
        return device, SensorProperties(axes)

    known = product_of if axes else unknown_product
    requested = requested_signals([info], [name], zero_phase=True, product=known)
    return ComparisonSide(requested, lambda column: (TIME, values[:, column.at]))


def of(name: str, a: str = "FLU", b: str = "FRD", **options: Any) -> ComparisonAnswer:
    sides = [side(a, name), side(b, name)]
    return compared(sides, sides, ComparisonOptions(**options))


@each_row("name", ["acc", "acc.z", "euler", "euler.y"])
@each_row(("a", "b"), [("FLU", "FRD"), ("FRD", "FLU")])
def test_one_motion_of_devices_with_other_axes_has_no_difference(name: str, a: str, b: str) -> None:
    """Regression: the mean of z differed by 19.6 m/s²."""
    for row in of(name, a, b).signals:
        assert row.figures["max"] == pytest.approx(0, abs=1e-3 if row.unit == "°" else 1e-9), row.signal
        assert row.figures["min"] == pytest.approx(0, abs=1e-3 if row.unit == "°" else 1e-9), row.signal
        if row.signal != "Attitude":
            assert row.notes == [row.notes[0]]
            assert row.notes[0].startswith("B is shown in the axes of A: ")


def test_attitudes_of_other_worlds_and_bodies_are_one() -> None:
    result = of("q").signals[-1]
    assert result.signal == "Attitude"
    assert result.figures["max"] == pytest.approx(0, abs=1e-5)
    assert result.figures["mounting"] == pytest.approx(0, abs=1e-5)


def test_correlation_is_of_the_same_axes() -> None:
    """Regression: FLU was correlated with FRD, to 0.53."""
    result = of("acc", align="correlation")
    assert result.correlation == pytest.approx(1.0)
    assert result.offset == pytest.approx(0.0, abs=1e-3)


def test_what_is_along_other_worlds_is_not_subtracted() -> None:
    for row in of("vel").signals:
        assert row.difference is None
        assert "is along the axes of ENU, and vel." in row.notes[0]
        assert "of NED. Compare signals along the same axes." in row.notes[0]


@each_row(("name", "b"), [("norm(acc)", "FRD"), ("acc.y", "FLU"), ("acc.y", "")])
def test_what_has_the_same_or_no_known_axes_is_compared_as_it_is(name: str, b: str) -> None:
    for row in of(name, "FLU", b).signals:
        assert row.notes == []
        assert row.figures["rms"] == pytest.approx(0, abs=1e-9)
