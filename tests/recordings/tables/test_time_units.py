"""Tables with times of any unit, epoch and step: the unit that is reported is right, or the file is refused."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.tables.clocks.axis import TimeAxis
from imuscope.recordings.tables.table_source import CsvSource
from imuscope.recordings.tables.time_units import UNITS
from tests.support.each_row import each_row

WRITTEN = 1_790_000_000.0  # when the files are written, unix s
INERTIAL = ("ax,ay,az", "gyro_x,gyro_y,gyro_z")
RATES = (
    0.01,
    0.1,
    0.5,
    1,
    2,
    5,
    10,
    20,
    25,
    30,
    50,
    60,
    75,
    100,
    125,
    200,
    250,
    400,
    500,
    800,
    1000,
    1600,
    2000,
    4000,
    8000,
)
DAY = 86_400.0


@dataclass(frozen=True)
class Table:
    """A table that was made."""

    heading: str
    unit: str
    times: tuple[float, ...]  # s
    decimals: int
    columns: str

    @property
    def text(self) -> str:
        scale = round(1 / UNITS[self.unit])
        rows = []
        for n, time in enumerate(self.times):
            whole, part = divmod(round(time * 1e9), 10**9)
            value = (whole * 10**9 + part) * scale / 1e9 if self.decimals else 0.0
            cell = f"{value:.{self.decimals}f}" if self.decimals else str((whole * 10**9 + part) * scale // 10**9)
            rows.append(f"{cell},{n % 7},0,9.81\n")
        return f"{self.heading},{self.columns}\n" + "".join(rows)


@st.composite
def tables(draw: st.DrawFn, units: Sequence[str] = tuple(UNITS)) -> Table:
    """Tables without a unit in the heading."""
    unit = draw(st.sampled_from(units))
    columns = draw(st.sampled_from((*INERTIAL, "x,y,z", "a,b,c")))
    slowest = 0.5 if columns in INERTIAL else 0.01  # nothing can tell ms at 0.1 Hz from µs at 100 Hz
    rate = draw(st.one_of(st.sampled_from([rate for rate in RATES if rate >= slowest]), st.floats(slowest, 4000)))
    longest = 40 * DAY if columns in INERTIAL and rate < 2000 else 18 * DAY  # then ms look like a recent date
    start = draw(
        st.one_of(
            st.just(0.0),
            st.floats(0, 10),
            st.floats(0, DAY),
            st.floats(0, longest),
            st.floats(WRITTEN - 10 * 365 * DAY, WRITTEN - DAY),
        )
    )
    count = draw(st.integers(3, 40))
    jitter = draw(st.sampled_from((0.0, 0.02, 0.2)))
    random = np.random.default_rng(draw(st.integers(0, 1 << 20)))
    steps = (1 + jitter * random.uniform(-1, 1, count)) / rate
    times = tuple((start + np.cumsum(steps) - steps[0]).tolist())
    decimals = draw(st.sampled_from({"s": (3, 6, 9), "ms": (0, 0, 3), "µs": (0, 0, 1), "ns": (0,)}[unit]))
    if unit != "s" and rate > 4000:  # nobody writes decimals of ms so often, and 10 Hz in s has to be plain
        decimals = 0
    heading = draw(st.sampled_from(("time", "timestamp", "Time", "TIMESTAMP", "t", "Timestamp")))
    return Table(heading, unit, times, decimals, columns)


def read(table: Table) -> tuple[TimeAxis, NDArray[np.float64]] | None:
    """The axis and the times of a table as a file, if it is not refused; its unit is right."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        path.write_text(table.text, encoding="utf-8")
        os.utime(path, (WRITTEN, WRITTEN))
        source = CsvSource(path)
        try:
            time = np.concatenate([rows.time for rows in source.rows()])
        except RecordingError:
            return None
    assert source.axis is not None
    assert source.axis.clock.unit == table.unit, source.axis.sentences()
    return source.axis, time


def check(table: Table) -> str:
    """Read a table; the unit that is taken, "" if it is refused."""
    if (results := read(table)) is None:
        return ""
    resolution = UNITS[table.unit] * 10.0**-table.decimals
    np.testing.assert_allclose(np.diff(results[1]), np.diff(np.array(table.times)), atol=2 * resolution + 1e-6)
    return table.unit


@given(tables())
def test_the_unit_is_right_or_requested(table: Table) -> None:
    check(table)


@st.composite
def disturbed(draw: st.DrawFn) -> tuple[Table, str]:
    """Tables whose rows run backwards, have no order, or begin before the clock was set; and which of these."""
    table = draw(tables())
    kind = draw(st.sampled_from(("backwards", "shuffled", "zeros", "uptime")))
    if kind == "backwards":
        return replace(table, times=table.times[::-1]), kind
    if kind == "shuffled":
        order = np.random.default_rng(draw(st.integers(0, 1 << 20))).permutation(len(table.times))
        return replace(table, times=tuple(table.times[i] for i in order)), kind
    begin = draw(st.integers(1, max(1, len(table.times) // 3)))
    early = [0.0 if kind == "zeros" else 1 + n for n in range(begin)]
    return replace(table, times=(*early, *table.times[begin:])), kind


def check_disturbed(table: Table, kind: str) -> None:
    """Read a table; its unit is right, or it is refused, and no time is invented."""
    if (result := read(table)) is None:
        return
    axis, time = result
    assert axis.watch is not None
    resolution = UNITS[table.unit] * 10.0**-table.decimals
    expected = np.array(table.times)
    if axis.order:
        expected = np.sort(expected)
    elif kind in ("backwards", "shuffled"):  # few rows: each step back is reported
        return
    if axis.clock.epoch == "1970":
        expected = expected[np.abs(expected) > resolution / 2]
    if not axis.watch.steps:  # each is reported
        np.testing.assert_allclose(np.diff(time), np.diff(expected), atol=2 * resolution + 1e-6)


@given(disturbed())
def test_the_unit_of_disturbed_rows_is_right_or_requested(case: tuple[Table, str]) -> None:
    check_disturbed(*case)


@pytest.mark.slow
@settings(max_examples=10_000)
@given(disturbed())
def test_the_unit_of_disturbed_rows_is_never_wrong(case: tuple[Table, str]) -> None:
    check_disturbed(*case)


@pytest.mark.slow
@pytest.mark.parametrize("unit", list(UNITS))
@settings(max_examples=2_500)  # 10 000 in all
@given(st.data())
def test_the_unit_is_never_wrong(unit: str, data: st.DataObject) -> None:
    check(data.draw(tables((unit,))))


@each_row("rate", [50, 100, 200, 400])
@each_row("unit", list(UNITS))
def test_usual_logs_of_an_inertial_sensor_are_not_queried(rate: float, unit: str) -> None:
    """Asking is always right, and of no use where the answer is plain."""
    times = tuple((112.5 + np.arange(50) / rate).tolist())
    assert check(Table("timestamp", unit, times, 6 if unit == "s" else 0, "ax,ay,az")) == unit


@each_row(
    ("heading", "unit"),
    [
        ("Zeit (Sekunden)", "s"),
        ("Millisekunden", "ms"),
        ("temps [secondes]", "s"),
        ("tiempo_milisegundos", "ms"),
        ('"Время, мс"', "ms"),
        ("время (мкс)", "µs"),
        ("时间(毫秒)", "ms"),
        ("時間（秒）", "s"),
        ("時間（ナノ秒）", "ns"),
        ("time （ms）", "ms"),
    ],
)
def test_a_unit_in_another_language_is_that_of_the_heading(heading: str, unit: str) -> None:
    times = tuple((0.01 * np.arange(20)).tolist())
    assert check(Table(heading, unit, times, 3 if unit == "s" else 0, "a,b,c")) == unit


@each_row(
    ("heading", "unit", "times"),
    [
        ("t", "µs", (0.0, 0.000889)),
        ("timestamp", "ms", (1_600_000.0, 1_600_000.0078)),
        ("uptime", "ms", (1_700_000.0, 1_700_000.01, 1_700_000.02)),
        ("time_elapsed", "µs", (1_700_000_000.0, 1_700_000_000.2, 1_700_000_000.4)),
        ("device_time", "ms", (50.0, 100.0, 150.0)),
    ],
)
def test_two_rows_and_running_times_do_not_decide_between_units(
    heading: str, unit: str, times: tuple[float, ...]
) -> None:
    """Such numbers are dates in one unit; a heading that says how long a device runs speaks against it."""
    assert check(Table(heading, unit, times, 0, "a,b,c")) in ("", unit)
