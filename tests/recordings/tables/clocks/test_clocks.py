"""Clocks of text tables: known columns of many programs, dates, wraps, steps, and what is refused."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.tables.options import TableOptions
from tests.recordings.tables.text_tables import EPOCH, N, read, table
from tests.support.each_row import each_row

UTC_PARTS = "UTC_Year,UTC_Month,UTC_Day,UTC_Hour,UTC_Minute,UTC_Second,UTC_Nano"
MIDNIGHT = "f'{(8639900 + n) // 360000 % 24:02}:{(8639900 + n) // 6000 % 60:02}:{(8639900 + n) % 6000 / 100:05.2f}'"


@each_row(
    ("heading", "cell", "start", "unit"),
    [
        ("%time", "10**7 * n + 1500000000 * 10**9", EPOCH, "ns"),
        ("field.header.stamp", "10**7 * n + 1500000000 * 10**9", EPOCH, "ns"),
        ("__time", "f'{1500000000 + n / 100:.6f}'", EPOCH, "s"),
        ("timestamp_us", "1500000000000000 + n * 10000", EPOCH, "µs"),
        ("time [msec]", "1500000000000 + n * 10", EPOCH, "ms"),
        ("week,timeOfWeek", "f'2398,{302400 + n / 100:.2f}'", 1_766_577_582, "s"),
        ("gps_week,iTOW", "f'2398,{302400000 + n * 10}'", 1_766_577_582, "ms"),
        ("stamp.sec,stamp.nanosec", "f'{1500000000 + n // 100},{n % 100 * 10**7}'", EPOCH, "s"),
        (UTC_PARTS, "f'2017,7,14,2,40,{n // 100},{n % 100 * 10**7}'", EPOCH, ""),
        ("datetime", "f'2017-07-14T02:40:{n / 100:09.6f}Z'", EPOCH, ""),
        ("datetime", "f'2017/07/14 02:40:{n / 100:09.6f}'", EPOCH, ""),
        ("datetime", "f'14.07.2017 02:40:{n / 100:09.6f}'", EPOCH, ""),
        ("timestamp", "f'7/14/2017 2:40:{n / 100:09.6f} AM'", EPOCH, ""),
        ("time (h)", "f'{1500000000 / 3600 + n / 360000:.12f}'", EPOCH, "h"),
        ("time (UTC)", "f'{1500000000 + n / 100:.2f}'", EPOCH, "s"),
        ("Date,Time", "f'2017-07-14,02:40:{n / 100:09.6f}'", EPOCH, ""),
        ("time", "f'2017-07-14 04:40:{n / 100:09.6f}+02:00'", EPOCH, ""),
    ],
)  # fmt: skip
def test_a_known_column_of_times_is_the_axis(heading: str, cell: str, start: float, unit: str, tmp_path: Path) -> None:
    source, rows = read(tmp_path / "a.csv", table(heading, cell))
    np.testing.assert_allclose(rows.time, start + np.arange(N) / 100, rtol=0, atol=2e-6)
    assert source.axis is not None
    assert source.axis.clock.unit == unit
    assert source.timed


@each_row(
    ("heading", "days", "program"),
    [
        ("time", 25_569.0, "Excel"),
        ("Date", 25_569.0, "Excel"),
        ("time (days)", 25_569.0, "Excel"),
        ("datenum", 719_529.0, "MATLAB"),
        ("time", 719_529.0, "MATLAB"),
        ("MJD", 40_587.0, "MJD"),
        ("time (UTC)", 40_587.0, "MJD"),
        ("JD", 2_440_587.5, "JD"),
    ],
)
def test_days_since_an_epoch_are_dates_and_reported_as_such(
    heading: str, days: float, program: str, tmp_path: Path
) -> None:
    cells = f"f'{{{days + EPOCH / 86_400!r} + n / 8_640_000:.12f}}'"
    source, rows = read(tmp_path / "a.csv", table(heading, cells))
    resolution = 86_400 * np.spacing(days + EPOCH / 86_400)
    np.testing.assert_allclose(rows.time, EPOCH + np.arange(N) / 100, rtol=0, atol=2 * resolution + 1e-6)
    assert source.axis is not None
    assert source.timed
    assert f"as days of {program}, since" in source.axis.sentences()[0]
    assert "shown as UTC" in source.axis.sentences()[0]


def test_days_since_the_start_stay_days(tmp_path: Path) -> None:
    source, rows = read(tmp_path / "a.csv", table("time (days)", "f'{n / 8640000:.12f}'"))
    np.testing.assert_allclose(rows.time - rows.time[0], np.arange(N) / 100, atol=1e-5)
    assert not source.timed


@each_row(
    ("heading", "cell", "period"),
    [
        ("millis", "(2**32 - 1000 + 10 * n) % 2**32", 2**32 / 1e3),
        ("time (us)", "(2**16 - 1000 + 10 * n) % 2**16", 2**16 / 1e6),
        ("Time", MIDNIGHT, 86_400),
        ("iTOW", "(604799000 + 10 * n) % 604800000", 604_800),
    ],
)  # fmt: skip
def test_what_wraps_is_continued(heading: str, cell: str, period: float, tmp_path: Path) -> None:
    source, rows = read(tmp_path / "a.csv", table(heading, cell))
    steps = np.diff(rows.time)
    np.testing.assert_allclose(steps, np.median(steps), rtol=0, atol=2e-6)
    assert source.axis is not None
    assert source.axis.watch is not None
    [step] = source.axis.watch.steps
    assert (step.kind, step.by_s) == ("wrap", pytest.approx(-period))
    assert source.axis.watch.segments == []


@each_row(
    ("heading", "cell", "words", "hint"),
    [
        ("time (s)", "1500000000", "the same time", "--time-column"),
        ("Date", "'2026-01-02'", "the same time", "--rate"),
        ("timestamp", "f'01/02/2026 10:30:{n / 100:05.2f}'", "day or the month first", "--date-order"),
        ("time", "n", "can be s (1 Hz) or ms (1000 Hz)", "--time-unit"),
        ("time", "n * 10**12", "fit no unit", "--time-unit"),
        ("time (ticks)", "n * 10", "the unit of time", "--time-unit"),
        ("a", "n", "no column of times", "--rate"),
    ],
)
def test_what_is_not_certain_is_refused_with_the_remedy(
    heading: str, cell: str, words: str, hint: str, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError) as refused:
        read(tmp_path / "a.csv", table(heading, cell))
    assert words in refused.value.message
    assert hint in refused.value.hint


def test_options_decide(tmp_path: Path) -> None:
    path, text = tmp_path / "a.csv", table("time", "n")
    for options, step in (
        (TableOptions(unit="ms"), 0.001),
        (TableOptions(rate=1.0), 1.0),
        (TableOptions(time_column="none", rate=50.0), 0.02),
        (TableOptions(time_column="1", unit="us"), 1e-6),
    ):
        _, rows = read(path, text, options)
        np.testing.assert_allclose(np.diff(rows.time), step, atol=5e-7)
    with pytest.raises(RecordingError, match="no column 'clock'"):
        read(path, text, TableOptions(time_column="clock"))
    with pytest.raises(RecordingError, match="not 60 Hz"):
        read(path, table("time (ms)", "n * 10"), TableOptions(rate=60.0))
    for order, start in (("dmy", 1_769_941_800), ("mdy", 1_767_349_800)):
        text = table("timestamp", "f'01/02/2026 10:30:{n / 100:05.2f}'")
        _, rows = read(path, text, TableOptions(date_order=order))  # type: ignore[arg-type]
        assert rows.time[0] == start


def test_every_other_clock_stays_a_column(tmp_path: Path) -> None:
    text = table(
        "time (s),TimeUS,Date,Time", "f'{1500000000 + n / 100:.2f},{n * 10000},2017-07-14,02:40:{n / 100:05.2f}'"
    )
    source, rows = read(tmp_path / "a.csv", text)
    assert source.axis is not None
    assert {one.name for one in source.axis.others} == {"Date + Time", "TimeUS"}
    np.testing.assert_allclose(rows.columns["TimeUS"][0], np.arange(N) * 10_000)
    np.testing.assert_allclose(rows.columns["Date + Time"][0], EPOCH + np.arange(N) / 100, atol=1e-6)
    assert source.damage == []


def test_cells_that_cannot_be_read_are_named_by_column_and_row(tmp_path: Path) -> None:
    text = table("time (s)", "1500000000 + n / 100").replace("1500000000.05,0,", "1500000000.05,n/a,")
    source, _ = read(tmp_path / "a.csv", text)
    assert [one.words for one in source.damage] == [
        "1 cell was not a number and was left empty: gx in row 6 ('n/a').",
    ]


@each_row("separator", [",", ";", "\t", "|", " "])
def test_a_heading_in_a_comment_and_any_separator(separator: str, tmp_path: Path) -> None:
    text = "# made by a logger\n#" + table(
        "timestamp [ns]".replace(" ", "" if separator == " " else " "), "10**7 * n", separator
    )
    _, rows = read(tmp_path / "a.txt", text)
    np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-6)
    assert list(rows.columns) == ["gx", "gy", "gz"]


def test_a_name_with_a_date_dates_a_clock_without_one(tmp_path: Path) -> None:
    source, rows = read(tmp_path / "log_2017-07-14_02-40-00.csv", table("time (ms)", "n * 10"))
    assert rows.time[0] == EPOCH
    assert source.axis is not None
    assert source.axis.dated_by == "the file's name"


@given(
    st.lists(st.tuples(st.integers(20, 60), st.floats(-500, 500)), min_size=1, max_size=4),
    st.sampled_from((10, 100, 400)),
)
def test_every_step_is_reported_with_its_size(parts: list[tuple[int, float]], rate: int) -> None:
    """Nothing is bent to increase: each step back is a segment, and within one the times are those of the clock."""
    clock, due, expected = [], 1000.0, []
    for number, (length, by) in enumerate(parts):
        moved = round(by, 2) if number and abs(by) > 1 else 0.0
        if moved:
            expected.append((len(clock), moved))
        clock += [due + moved + n / rate for n in range(length)]
        due = clock[-1] + 1 / rate
    text = "time (s),gx\n" + "".join(f"{time:.6f},1\n" for time in clock)
    with tempfile.TemporaryDirectory() as folder:
        source, rows = read(Path(folder) / "a.csv", text)
    assert source.axis is not None
    assert source.axis.watch is not None
    watch = source.axis.watch
    assert [(step.row, round(step.by_s, 2)) for step in watch.steps] == [
        (row, pytest.approx(by, abs=0.02)) for row, by in expected
    ]
    backs = {row for row, by in expected if by < 0}
    steps = np.diff(rows.time)
    for row in range(len(clock) - 1):
        if row + 1 in backs:
            assert steps[row] > 0
        else:
            assert steps[row] == pytest.approx(clock[row + 1] - clock[row], abs=2e-6)


RECENT = 1_780_000_000


@each_row(
    ("heading", "cell", "start", "words"),
    [
        ("time", "f'Thu May 28 20:26:{40 + n // 100} 2026'", RECENT, "dates and times"),
        ("time", "f'Thu May 28 20:26:{40 + n // 100} UTC 2026'", RECENT, "dates and times"),
        ("time", "f'\"May 28, 2026 20:26:{40 + n / 100:05.2f}\"'", RECENT, "dates and times"),
        ("time", "f'2026-05-28 22:26:{40 + n / 100:05.2f} CEST'", RECENT, "dates and times"),
        ("time", "f'2026-05-29 04:26:{40 + n / 100:05.2f} GMT+8'", RECENT, "dates and times"),
        ("time", "f'2026-05-28 16:26:{40 + n / 100:05.2f}-0400 [Brazil/West]'", RECENT, "dates and times"),
        ("time", "f'2026-05-28_20-26-{40 + n // 100}'", RECENT, "dates and times"),
        ("ms_of_day", "f'{10 * n + 50}'", None, "ms_of_day in ms, of a day that is not in the file"),
        (
            "host_time_s,device_time_us",
            f"f'{{{RECENT} + n // 10 / 10:.1f}},{{n * 10000}}'",
            RECENT,
            "device_time_us in µs",
        ),
        ("Time", "f'10:{n / 100:06.3f}'", None, "minutes and seconds, without the hour"),
        ("time", f"f'{{{RECENT + 2_082_844_800} + n / 100:.2f}}'", RECENT, "as s of LabVIEW, since 1904"),
        ("timestamp", f"f'{{{RECENT - 978_307_200} + n / 100:.2f}}'", RECENT, "as s of Apple, since 2001"),
        ("timestamp", f"({RECENT} + 11644473600) * 10**7 + n * 10**5", RECENT, "as 100 ns of Windows, since 1601"),
        ("ticks", f"({RECENT} + 62135596800) * 10**7 + n * 10**5", RECENT, "as 100 ns of .NET, since the year 1"),
        ("X[s]", "f'{n / 100:.2f}'", None, "X in s"),
        ("Sec", "f'{n / 100:.2f}'", None, "Sec in s"),
        ("Zeitstempel", "f'{n / 100:.2f}'", None, "Zeitstempel in s"),
        ("タイムスタンプ", "n * 10", None, "タイムスタンプ in ms"),
        ("timer_us", "n * 10000", None, "timer_us in µs"),
        ("timestamp", f"{RECENT * 1000} + n * 10 if n > 20 else 0", RECENT + 0.21, "in ms, since 1970"),
    ],
)
def test_more_ways_to_write_a_time(heading: str, cell: str, start: float | None, words: str, tmp_path: Path) -> None:
    text = table(heading, cell)
    source, rows = read(tmp_path / "a.csv", text)
    assert source.axis is not None
    assert words in source.axis.sentences()[0]
    assert start is None or rows.time[0] == pytest.approx(start, abs=2e-5)
    fine = [one for one in np.diff(rows.time) if one]
    np.testing.assert_allclose(fine, 0.01 if len(fine) > 9 else 1.0, rtol=0, atol=2e-5)


@each_row("reverse", [True, False])
def test_rows_that_do_not_ascend_are_read_in_the_order_of_their_times(reverse: bool, tmp_path: Path) -> None:
    lines = table("time (s)", f"f'{{{EPOCH} + n / 100:.2f}}'").splitlines()
    rows = lines[:0:-1] if reverse else random.Random(1).sample(lines[1:], N)
    source, result = read(tmp_path / "a.csv", "\n".join([lines[0], *rows]) + "\n")
    np.testing.assert_allclose(result.time, EPOCH + np.arange(N) / 100, atol=2e-6)
    np.testing.assert_array_equal(result.columns["gx"][0], np.arange(N) % 5)
    assert source.axis is not None
    assert source.axis.watch is not None
    assert source.axis.watch.steps == []
    assert f"The rows {'run backwards' if reverse else 'are out of order'}" in " ".join(source.axis.sentences())


@each_row("cell", ["f'{n % 20 / 100:.2f}'", "n * 10 % 256 / 1000", "f'{n % 2 * 50 + n // 2 / 100:.2f}'"])
def test_a_clock_that_is_set_or_wraps_often_is_not_sorted(cell: str, tmp_path: Path) -> None:
    source, rows = read(tmp_path / "a.csv", table("time (s)", cell))
    assert source.axis is not None
    assert not source.axis.order
    np.testing.assert_array_equal(rows.columns["gx"][0], np.arange(N) % 5)


@each_row(
    ("parts", "fraction"),
    [("{},{}", 10**7), ("{} {}", 10**4), ("{},{},imu_link", 10**7), ("7,{},{}", 10**7)],
)
def test_seconds_and_parts_of_one_need_no_names(parts: str, fraction: int, tmp_path: Path) -> None:
    separator = " " if " " in parts else ","
    lines = [
        separator.join((parts.format(EPOCH + n // 100, n % 100 * fraction), str(n % 5), "0", "9.8")) for n in range(N)
    ]
    source, rows = read(tmp_path / "a.csv", "\n".join(lines) + "\n")
    assert source.axis is not None
    assert "they rise together, as seconds and" in source.axis.sentences()[0]
    np.testing.assert_allclose(rows.time, EPOCH + np.arange(N) / 100, atol=2e-6)


@each_row(
    "head",
    [
        "Sample interval: 10 ms",
        "# dt = 0.01 s",
        '"Sample Rate","100.000",Hz,,"Duration","3.0","s"',
    ],
)
def test_the_head_names_the_time_between_samples(head: str, tmp_path: Path) -> None:
    source, rows = read(tmp_path / "a.csv", f"{head}\ngx,gy,gz\n" + "".join(f"{n % 5},0.5,1\n" for n in range(N)))
    assert source.axis is not None
    np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-6)
    assert "the head of the file names the rate" in source.axis.sentences()[0]


@each_row(
    "head",
    [
        '"Date","Tuesday, July 14, 2017"\n"Time","2:40:00 AM"',
        '"Log Date","14/07/2017",,,"Origin Time","0","s"\n"Log Time","02:40:00",,,"Start Time","0","s"',
        "StartTime:,2017-07-14_02-40-00-000",
        "StartTime: ,2017-07-14_10:40:00_000 GMT+8",
    ],
)
def test_the_head_names_the_start(head: str, tmp_path: Path) -> None:
    source, rows = read(tmp_path / "a.csv", f"{head}\n\n" + table("Time (s)", "n / 100"))
    assert source.axis is not None
    assert source.axis.dated_by == "the head of the file"
    assert rows.time[0] == EPOCH
