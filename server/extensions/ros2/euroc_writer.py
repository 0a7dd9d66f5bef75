"""EuRoC folders: rate of turn and acceleration of each device, as Kalibr, VINS and others read them.

    mav0/imu0/data.csv       #timestamp [ns],w_RS_S_x [rad s^-1],…,a_RS_S_x [m s^-2],…     for each moment with both
    mav0/imu0/sensor.yaml    name, rate, axes, and which quantities are left out

Numbers are SI units in full; axes are those of the device. Noise is not in the file, because a recording has no
analysis with it: `imuscope analyse FILE allan --format kalibr` writes it.

Source: M. Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 35 (2016), and the files of the data sets.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from imuscope.recordings.exporters.csv_tables import heading, lines
from imuscope.recordings.exporters.message_table import join, windows
from imuscope.recordings.exporters.request import ExportError, ExportRequest, ExportStep, usual_interval
from imuscope.recordings.exporters.topics import stamps
from imuscope.server.devices.decode.protocol_set import sensors_of
from imuscope.server.extensions.ros2.joined_rows import values_of
from imuscope.server.extensions.ros2.quantities import HINT, Place, recorded_quantities

HEADINGS = (
    "#timestamp [ns]",
    *(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"),
    *(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"),
)
AXES = {"FLU": "x forward, y left, z up", "FRD": "x forward, y right, z down"}


def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """Write the folder; returns it.

    Raises:
        ExportError: no device has both quantities.
    """
    request = replace(request, columns=request.columns.in_units("device"))  # bit by bit, where that is SI
    devices: list[tuple[Mapping[str, Any], Place, Place]] = []
    for device in request.columns.manifest["devices"]:
        of = recorded_quantities(device, request.infos)
        if of.turn and of.acceleration:
            devices.append((device, of.turn, of.acceleration))
    if not devices:
        raise ExportError("No device has a rate of turn and an acceleration in known units.", HINT)
    for number, (device, turn, acceleration) in enumerate(devices):
        folder = out / "mav0" / f"imu{number}"
        folder.mkdir(parents=True)
        left_out = _table(
            request,
            (turn, acceleration),
            folder / "data.csv",
            lambda share, n=number: step((n + share) / len(devices)),  # type: ignore[misc]
        )
        (folder / "sensor.yaml").write_text(_about(request, device, (turn, acceleration), left_out), encoding="utf-8")
    return [out]


def _table(request: ExportRequest, places: tuple[Place, Place], path: Path, step: ExportStep) -> int:
    """Write the samples; returns the number of moments that lack a number."""
    ranges = {place.channel: request.rows(place.channel) for place in places}
    total, left_out, done = sum(past - first for first, past in ranges.values()), 0, 0
    with path.open("wb") as file:
        heading(file, HEADINGS)
        for window in windows(request.columns, ranges, base="arrival"):
            parts = [request.columns.exact(place.channel, *window[place.channel]) for place in places]
            joined = join(
                parts, [request.columns.clock(place.channel, *window[place.channel], "place") for place in places]
            )
            values = np.full((len(joined.time), 6), np.nan)
            for first, place, part, at in zip((0, 3), places, parts, joined.at, strict=True):
                own = values_of(place, [part.arrival, part.time, *part.columns])
                rows = np.arange(len(own)) if at is None else at
                values[rows >= 0, first : first + 3] = own[rows[rows >= 0]]
            whole = np.isfinite(values).all(axis=1)
            left_out += int((~whole).sum())
            arrays = [stamps(joined.arrival, joined.time)[whole], *values[whole].T]
            lines(file, pa.RecordBatch.from_arrays([pa.array(one) for one in arrays], names=list(HEADINGS)))
            done += sum(past - first for first, past in window.values())
            step(done / total)
    return left_out


def _about(request: ExportRequest, device: Mapping[str, Any], places: tuple[Place, Place], left_out: int) -> str:
    held = {place.channel for place in places}
    others = [info["name"] for info in request.infos if info["device"] == device["id"] and info["id"] not in held]
    interval = usual_interval(request.columns, places[0].channel)
    own = AXES[sensors_of(device["protocol"], device.get("product", "")).axes]
    axes = f"Axes of the device: {own}." if device["protocol"] else "Axes are as in the file."
    identity = ", ".join("1.0" if at % 5 == 0 else "0.0" for at in range(16))
    return "\n".join(
        (
            f"# {json.dumps(request.title)}, exported by imuscope",
            "sensor_type: imu",
            f"comment: {json.dumps(request.device_name(device['id']))}",
            f"# {axes}",
            f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{identity}]",
            f"rate_hz: {1 / interval:.6g}" if interval else "# rate_hz is not known.",
            "# Noise is not known without an Allan analysis: imuscope analyse FILE allan --format kalibr",
            f"# Segments of the clock begin at, unix s: {json.dumps(list(request.segments(device['id'])))}",
            f"# Moments left out, because they lack one of the numbers: {left_out}.",
            f"# Quantities left out: {json.dumps(', '.join(others) or 'none')}.",
            "",
        )
    )
