"""One attitude has one set of Euler angles: in values, exports, expressions, calibrations, comparisons and on the page.

The page reads the same table (web/src/data/rotations.test.ts).
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.arrays import Floats
from imuscope.protocols.isb.family import frame_angles
from imuscope.protocols.rotations import (
    angle_of,
    conjugate,
    euler_columns,
    euler_of,
    matrix_of,
    of_euler,
    product,
    quaternion_columns,
    quaternion_of,
    quaternions,
)
from imuscope.server.extensions.analysis.expressions.signal_request import requested_signals
from imuscope.server.extensions.calibration.mounting import mounting_angles
from imuscope.server.wire import ChannelInfo, ColumnInfo
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

ROWS = json.loads((ROOT / "tests" / "golden" / "euler.json").read_text())["rows"]


def by_an_expression(q: Floats) -> list[float]:
    columns = [ColumnInfo(name=f"q{k}", dtype="f8") for k in range(4)]
    fields: dict[str, Any] = {"id": 1, "device": "1", "name": "Quaternion", "title": "Quaternion", "kind": "quaternion"}
    info = ChannelInfo(**fields, message="M", unit="", frame="", columns=columns)
    [request] = requested_signals([info], ["euler(Quaternion)"], zero_phase=True)
    results = request.signals(lambda column: (np.arange(3.0), np.full(3, q[column.at])))
    return [float(one.values[0]) for one in results]


@each_row("row", ROWS, ids=lambda row: row["what"])
def test_every_place_shows_the_same_angles(row: dict[str, Any]) -> None:
    """Regression: of roll 30°, pitch 90°, yaw 20° a calibration said (30, 90, 20), and the values (0, 90, −10)."""
    q = np.array(row["quaternion"])
    matrix = matrix_of(q)
    places = {
        "values and exports, of a quaternion": [float(one[0]) for one in euler_columns(q.reshape(4, 1))],
        "values and exports, of a matrix": [float(one[0]) for one in euler_columns(matrix.reshape(9, 1))],
        "expressions": by_an_expression(q),
        "calibration": mounting_angles(matrix),
        "simulators": np.degrees(euler_of(q.reshape(1, 4))[0]).tolist(),
        "settings of devices": np.degrees(frame_angles(matrix.T)).tolist(),
    }
    for place, angles in places.items():
        off = [math.remainder(got - want, 360) for got, want in zip(angles, row["euler"], strict=True)]
        assert off == pytest.approx([0, 0, 0], abs=1e-4), place
    back = {
        "comparison": np.stack(quaternion_columns([np.array([angle]) for angle in row["euler"]]), -1)[0],
        "simulators": of_euler(np.radians(row["euler"])),
        "ROS and other programs": quaternions("euler", [np.array([angle]) for angle in row["euler"]])[0],
        "of a matrix, for other programs": quaternions("matrix", list(matrix.reshape(9, 1)))[0],
        "settings of devices": quaternion_of(matrix),
    }
    for place, other in back.items():
        assert float(angle_of(product(conjugate(q), other))) == pytest.approx(0, abs=1e-4), place
