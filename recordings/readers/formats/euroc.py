"""EuRoC folders: one table for each sensor, as data sets of visual-inertial odometry have them.

    mav0/imu0/data.csv       #timestamp [ns],w_RS_S_x [rad s^-1],…,a_RS_S_z [m s^-2]
    mav0/imu0/sensor.yaml    sensor_type, rate_hz, noise
    mav0/imu1/…  mav0/state_groundtruth_estimate0/…  mav0/cam0/…  (a list of pictures, which is left out)

A table has the name of its folder. The segments of the clock are those that our own export names (`SEGMENTS`).

Source: M. Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 35 (2016), and the files of the data sets.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.folders import SENSOR, SENSOR_DATA, sensor_folders
from imuscope.recordings.readers.formats.table_set import TableSet
from imuscope.recordings.sources import FileDamage, remark
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.table_rows import TableRows
from imuscope.recordings.tables.table_source import CsvSource, TableSource

MAX_SENSOR_BYTES = 1 << 16  # bytes of a sensor.yaml that are read
_SEGMENTS = re.compile(r"^# Segments of the clock begin at, unix s: (\[.*\])$", re.MULTILINE)
_RATE = re.compile(r"^rate_hz: *([0-9.]+)", re.MULTILINE)


class EurocTable(CsvSource):
    """The table of a sensor.

    Args:
        sensor: name of its folder.
        about: text of its sensor.yaml; "" without one.
    """

    def __init__(self, path: Path, options: TableOptions, sensor: str, about: str) -> None:
        super().__init__(path, options)
        self._sensor = sensor
        self._begins = _begins(about)
        rate = _RATE.search(about)
        if rate is not None and self.axis is not None:
            self.axis.head_rate = float(rate[1])

    def rows(self) -> Iterator[TableRows]:
        for rows in super().rows():
            segment = np.searchsorted(self._begins, rows.time, "right").astype(np.float64) if self._begins else None
            yield replace(rows, table=self._sensor, segment=segment)


def open_euroc_folder(folder: Path, options: TableOptions) -> TableSource:
    """The tables of a folder.

    Raises:
        RecordingError: none of them can be read.
    """
    tables: list[TableSource] = []
    errors: list[FileDamage] = []
    first: RecordingError | None = None
    for one in sensor_folders(folder):
        try:
            tables.append(EurocTable(one / SENSOR_DATA, options, one.name, _about(one / SENSOR)))
        except RecordingError as error:
            first = first or error
            errors.append(remark(f"{one.name} is left out: {error.text}"))
    if not tables:
        assert first is not None
        raise first
    source = TableSet(folder, tables)
    source.damage += errors
    return source


def _about(path: Path) -> str:
    try:
        with open_regular(path) as file:
            return file.read(MAX_SENSOR_BYTES).decode(errors="replace")
    except OSError:
        return ""


def _begins(about: str) -> Sequence[float]:
    match = _SEGMENTS.search(about)
    try:
        begins = json.loads(match[1]) if match is not None else []
        return sorted(float(one) for one in begins)
    except (ValueError, TypeError, RecursionError):
        return ()
