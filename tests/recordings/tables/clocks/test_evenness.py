"""Choice between the clocks of a table: the finest and evenest one of the sensor is the axis, dated by the other."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.tables.dates import utc_text
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.table_source import CsvSource
from tests.recordings.tables.field_files import field_file
from tests.recordings.tables.text_tables import read

N, STEP = 400, 0.01
START = datetime(2026, 3, 2, 10, tzinfo=UTC).timestamp()
DELAY = np.random.default_rng(1).exponential(0.02, N)  # of the program that writes the log, s


def _table(first: str, second: str) -> str:
    """A clock of the phone in bursts or with delays, and one of the sensor."""
    times = np.arange(N) * STEP
    packets = START + (np.arange(N) // 25 + 1) * 25 * STEP + 0.004
    delayed = np.maximum.accumulate(START + times + DELAY)
    cells = {
        "burst": [f"{one:.3f}" for one in packets],
        "text": [utc_text(one) for one in packets],
        "jitter": [f"{one:.3f}" for one in delayed],
        "device": [f"{round((5 + one) * 1e9)}" for one in times],
    }
    rows = zip(cells[first.partition(" ")[0]], cells[second.partition(" ")[0]], strict=True)
    names = [one.partition(" ")[2] for one in (first, second)]
    return "\n".join([",".join((*names, "x", "y", "z")), *(f"{a},{b},{n % 7},0,9" for n, (a, b) in enumerate(rows))])


@pytest.mark.parametrize(
    "first",
    [
        "burst Phone timestamp (s)",
        "text Phone timestamp",
        "jitter timestamp (s)",
        "text loggingTime(txt)",
        "jitter time (s)",
    ],
)
@pytest.mark.parametrize("second", ["device sensor timestamp [ns]", "device motionTimestamp_sinceReboot (ns)"])
def test_the_clock_of_the_program_that_wrote_the_log_is_not_the_axis(first: str, second: str, tmp_path: Path) -> None:
    source, rows = read(tmp_path / "a.csv", _table(first, second))
    assert source.axis is not None
    assert source.axis.name == second.partition(" ")[2].split(" [")[0].split(" (")[0]
    assert 1 / source.axis.usual_s == pytest.approx(100, rel=1e-4)
    np.testing.assert_allclose(np.diff(rows.time), STEP, atol=1e-6)
    least = 0.014 if "jitter" not in first else float(DELAY.min())  # of a packet's last sample; the soonest row
    assert rows.time[0] == pytest.approx(START + least, abs=2e-3)
    assert source.axis.dated_by == first.partition(" ")[2].split(" (")[0].split("(")[0]


def test_a_clock_that_is_chosen_stays_the_axis(tmp_path: Path) -> None:
    table = _table("jitter timestamp (s)", "device sensor timestamp [ns]")
    source, _ = read(tmp_path / "a.csv", table, TableOptions(time_column="timestamp (s)"))
    assert source.axis is not None
    assert source.axis.name == "timestamp"


def test_the_rate_of_a_jittered_clock_is_that_of_its_rows(tmp_path: Path) -> None:
    table = _table("jitter timestamp (s)", "device sensor timestamp [ns]")
    source, _ = read(tmp_path / "a.csv", table, TableOptions(time_column="1"))
    assert source.axis is not None
    assert 1 / source.axis.usual_s == pytest.approx(100, rel=0.1)
    packets = _table("burst time (s)", "device other (V)")
    source, _ = read(tmp_path / "b.csv", packets)
    assert source.axis is not None
    assert 1 / source.axis.usual_s == pytest.approx(100, rel=0.1)


def test_a_finer_clock_of_a_sensor_of_the_field_is_the_axis() -> None:
    source = CsvSource(field_file("polar_phone_and_sensor_clock.txt"))
    [rows] = source.rows()
    assert source.axis is not None
    assert (source.axis.name, source.axis.dated_by) == ("sensor timestamp", "Phone timestamp")
    assert 1 / source.axis.usual_s == pytest.approx(52, rel=1e-3)
    assert rows.time[0] == pytest.approx(START, abs=0.5)
