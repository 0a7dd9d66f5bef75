"""Clocks of text tables in two columns, in other digits, or coarser than the samples."""

import io
from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.tables.dates import utc_text
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.clocks import figures
from imuscope.server.extensions.clocks.print_clocks import print_clocks
from tests.recordings.tables.text_tables import EPOCH, N, read, table
from tests.support.each_row import each_row
from tests.support.truth_frames import even_ticks, opened, xbus_stream

STEPS = np.arange(N) / 100


@each_row(
    ("heading", "cell", "start"),
    [
        ("time,ms", "f'2017-07-14 02:40:{n // 100:02},{n % 100 * 10}'", EPOCH),
        ("Date,Time,Millisecond", "f'2017-07-14,02:40:{n // 100:02},{n % 100 * 10}'", EPOCH),
        ("timestamp,usec", "f'{1500000000 + n // 100},{n % 100 * 10000}'", EPOCH),
        ("time_ms,time", "f'{n % 100 * 10},2017-07-14 02:40:{n // 100:02}'", EPOCH),
        ("year,month,day,hour,minute,second,ms", "f'2017,7,14,2,{39 + n // 100},59,{n % 100 * 10}'", None),
        ("year,month,day,hour,minute,second,ms", "f'2017,7,14,2,40,{n // 100},{n % 100 * 10}'", EPOCH),
    ],
)
def test_parts_of_a_second_in_a_column_of_their_own_complete_the_time(
    heading: str, cell: str, start: float | None, tmp_path: Path
) -> None:
    """All rows of a second had one time, or a segment began each second."""
    source, rows = read(tmp_path / "a.csv", table(heading, cell))
    assert source.axis is not None
    assert source.axis.watch is not None
    assert " + " in source.axis.name
    assert source.timed
    if start is not None:
        np.testing.assert_allclose(rows.time, start + STEPS, rtol=0, atol=2e-6)
        assert not source.axis.watch.steps
    else:  # second 59 of three minutes
        assert np.diff(rows.time).max() == pytest.approx(59.01)
    assert set(rows.columns) <= {"gx", "gy", "gz", "year", "month", "day", "hour", "minute", "second"}


def test_milliseconds_of_something_else_stay_a_column(tmp_path: Path) -> None:
    _, rows = read(tmp_path / "a.csv", table("time,latency_ms", "f'2017-07-14 02:40:{n // 100:02},{n * 37 % 90}'"))
    assert "latency_ms" in rows.columns
    np.testing.assert_array_equal(np.unique(rows.columns["time"][0]), EPOCH + np.arange(3))
    np.testing.assert_allclose(rows.time, EPOCH + STEPS, rtol=0, atol=2e-6)


@each_row(
    ("heading", "cell", "unit"),
    [
        ("timestamp", "f'{5000 + 10 * n:08X}'", "ms"),
        ("time (ms)", "f'{5000 + 10 * n:x}'", "ms"),
        ("timestamp", "f'0x{5000000 + 10000 * n:08x}'", "µs"),
        ("time_ms", "f'{(2**32 - 1000 + 10 * n) % 2**32:08X}'", "ms"),
    ],
)
def test_times_in_hexadecimal_digits_are_read(heading: str, cell: str, unit: str, tmp_path: Path) -> None:
    """Some were other numbers, some none, and the years went beyond those of dates."""
    source, rows = read(tmp_path / "a.csv", table(heading, cell))
    assert source.axis is not None
    assert (source.axis.clock.unit, source.axis.clock.base) == (unit, 16)
    np.testing.assert_allclose(rows.time - rows.time[0], STEPS, rtol=0, atol=2e-6)
    assert "hexadecimal" in source.axis.sentences()[0]


def test_values_in_hexadecimal_digits_are_no_other_numbers(tmp_path: Path) -> None:
    """Cells without a letter were read as usual digits."""
    text = table("time (s),raw,marked", "f'{n / 100:.2f},{n:04X},0x{n:04X}'")
    source, rows = read(tmp_path / "a.csv", text)
    np.testing.assert_array_equal(rows.columns["marked"][0], np.arange(N))
    assert np.isnan(rows.columns["raw"][0]).all()
    assert source.texts() == {"raw": "0000"}


@each_row("heading", ["", "time", "elapsed"])
def test_differences_of_times_are_read(heading: str, tmp_path: Path) -> None:
    """A table of pandas without dates was refused."""
    source, rows = read(tmp_path / "a.csv", table(heading, "f'{n // 100} days 00:00:{n % 100 / 100:09.6f}'"))
    assert source.axis is not None
    assert source.axis.clock.epoch == "start"
    days = np.arange(N) // 100 * 86_400.0 + np.arange(N) % 100 / 100
    np.testing.assert_allclose(rows.time - rows.time[0], days, rtol=0, atol=2e-6)


def test_times_that_are_coarser_than_the_samples_are_spread_over_them(tmp_path: Path) -> None:
    source, _ = read(tmp_path / "a.csv", table("time", "f'2017-07-14 02:40:{n // 100:02}'"))
    assert source.axis is not None
    assert source.axis.sentences()[-1] == (
        "100 rows share each time of time: they are spread over the packet, whose first sample has it (it counts steps "
        "of 1 s; to change it: --packet-stamp last)."
    )


def test_dates_of_too_few_digits_are_refused(tmp_path: Path) -> None:
    """Dates in steps of 128 s, as a float32 has them, were milliseconds since a start."""
    with pytest.raises(RecordingError, match="300 rows have 2 different times in timestamp"):
        read(tmp_path / "a.csv", table("timestamp", "1500000000 + n // 150 * 128"))


def test_a_time_beyond_the_years_of_dates_is_printed(tmp_path: Path) -> None:
    """It ended in a traceback."""
    path = tmp_path / "a.csv"
    path.write_text(table("time (s)", "n / 100 if n < 250 else n * 1e12"))
    out = io.StringIO()
    print_clocks(path, DecodeOptions(), out, io.StringIO())
    assert "2262-04-11" in out.getvalue()
    assert utc_text(1e11) == "1e+11 s since 1970"


def test_the_unit_of_a_clock_is_found_beside_steps_of_the_axis() -> None:
    """A host that stalls has its device's time corrected in steps, which the ticks of the device lack."""
    ticks = np.arange(0.0, 40_000.0, 100.0)
    axis = ticks * 1e-4
    axis[100:] += 0.15
    axis[200:] += 0.15
    axis[300:] += 0.15
    axis[350:] += 0.15
    axis[150:] += 0.15
    assert figures._unit_of(ticks, axis) == (1e-4, "100 µs")
    assert figures._unit_of(ticks, axis * 1.3)[1].startswith("counts of")


def test_the_unit_of_a_clock_is_that_which_its_protocol_states(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: a pause in the first second of a live source bent the axis, and "counts of 5e-05 s" stayed."""
    monkeypatch.setattr(figures, "_unit_of", lambda values, axis: (5e-5, "counts of 5e-05 s"))
    with opened(tmp_path / "a.bin", xbus_stream(range(500), even_ticks(500))) as recording:
        [message] = figures.clocks_of(recording._store)
    assert {clock.name: clock.unit for clock in message.clocks}["SampleTimeFine"] == "100 µs"
