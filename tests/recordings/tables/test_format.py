"""Heads of tables, read cell by cell: units, dates, scales and rates; one odd word costs itself and is reported."""

from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.tables.table_source import CsvSource
from tests.recordings.tables.field_files import field_file
from tests.recordings.tables.text_tables import read
from tests.support.each_row import each_row

UTC = 1_772_445_600  # 2026-03-02 10:00:00
DAY = UTC - 36_000
ROWS = [(f"{k * 0.05:.3f}", k % 5 / 10, 1, 9, k) for k in range(60)]
NAMES = ["Time", "AccelX", "AccelY", "AccelZ", "Lap"]
PREAMBLES = [  # of programs, before the names
    [["Format", "AiM CSV File"], ["Session", "Somewhere"], ["Beacon Markers", "5.5"], []],
    [["Sample Rate", "20"], ["Segment Times", "00:05.5"]],
    [["Created", "02.03.2026", "10:00"], ["Note"], []],
    [["Device", "MetaMotion"], ["Firmware", "1.7.3"], ["Serial", "123456"]],
    [["1"], ["Start", "2026-03-02T10:00:00Z"]],
]


def lines(head: list[list[str]], separator: str = ",", *, padded: bool) -> str:
    def line(cells: list[str]) -> str:
        width = len(NAMES) if padded else len(cells)
        return separator.join([*map(str, cells), *[""] * (width - len(cells))])

    return "\n".join(line([*map(str, one)]) for one in (*head, NAMES, *ROWS)) + "\n"


@each_row("preamble", PREAMBLES, ids=lambda preamble: preamble[0][0])
@each_row("separator", [",", ";", "\t"])
def test_a_preamble_that_a_spreadsheet_filled_up_is_no_rows(
    preamble: list[list[str]], separator: str, tmp_path: Path
) -> None:
    """Regression: lines of the preamble with the commas of the rows became rows, and the first names headings."""
    source, rows = read(tmp_path / "a.csv", lines(preamble, separator, padded=True))
    assert len(rows.time) == len(ROWS)
    np.testing.assert_allclose(np.diff(rows.time), 0.05, atol=1e-6)
    assert list(rows.columns) == NAMES[1:]
    assert not [one for one in source.damage if not one.is_remark]


def test_rows_with_few_cells_are_not_a_preamble(tmp_path: Path) -> None:
    head = "time (s),ax,ay,az,lat,lon,alt\n0.0,1,,,,,\n"
    text = head + "".join(f"{k / 10},{k},2,9,48,11,5\n" for k in range(1, 30))
    _, rows = read(tmp_path / "a.csv", text)
    assert len(rows.time) == 30


@each_row("word", ["lap no", "whatever", "12 bits raw", "on/off", "date"])
@each_row("at", range(1, 5))
def test_one_word_that_is_no_unit_does_not_cost_the_others(word: str, at: int, tmp_path: Path) -> None:
    units = ["s", "g", "g", "g", "km/h"]
    units[at] = word
    source, rows = read(tmp_path / "a.csv", "\n".join([",".join(NAMES), ",".join(units), *row_texts()]) + "\n")
    assert [unit for _, unit in rows.columns.values()] == ["" if unit == word else unit for unit in units[1:]]
    [odd] = [one.words for one in source.damage if "not units" in one.words]
    assert f"{word!r} ({NAMES[at]})" in odd
    np.testing.assert_allclose(np.diff(rows.time), 0.05, atol=1e-6)


def row_texts() -> list[str]:
    return [",".join(map(str, row)) for row in ROWS]


@each_row(
    ("head", "first"),
    [
        ("Capture Date: Mon Mar 02 10:00:00 UTC 2026\n", UTC),
        ('"Capture Date: Mon Mar 02 10:00:00 UTC 2026"\n', UTC),
        ("File created on 02/03/2026 @ 10:00\n", UTC),
        ("File created on 02/03/2026 at 10:00:00\n", UTC),
        ('Date,"Monday, March 2, 2026"\nTime,10:00 AM\n', UTC),
        ("# Recording date: 2026-03-02 10:00:00\n", UTC),
        ("Created: Mar 2, 2026 10:00:00 AM\n", UTC),
        ("Session date: Mar 2, 2026\n", DAY),
        ("Session date,Mar 2, 2026\n", DAY),
        ('"Created","Mar 2, 2026"\n', DAY),
        ("Log date: 2026-03-02\n", DAY),
        ("Log date: 02.03.2026\n", DAY),
    ],
)
def test_a_date_in_the_head_dates_the_table(head: str, first: float, tmp_path: Path) -> None:
    source, rows = read(
        tmp_path / "a.csv", head + "time (s),x,y,z\n" + "".join(f"{k / 20},{k},0,9\n" for k in range(60))
    )
    assert rows.time[0] == pytest.approx(first, abs=1e-6)
    assert source.axis is not None
    assert source.axis.dated_by.startswith("the head of the file")


def test_a_day_in_the_head_dates_times_of_day(tmp_path: Path) -> None:
    text = "File created on 02/03/2026\ntime,x,y,z\n"
    text += "".join(f"{15 + k // 3600:02}:00:{k // 20:02}.{k % 20 * 5:02},{k},0,9\n" for k in range(60))
    _, rows = read(tmp_path / "a.csv", text)
    assert rows.time[0] == pytest.approx(DAY + 15 * 3600, abs=1e-6)


@each_row(
    "head",
    [
        *(
            "Sample Rate,20",
            "Sampling rate (Hz),20",
            "Sampling Frequency [Hz]: 20",
            "# fs = 20",
            "Log Rate (Hz) : 20.00",
        ),
        *(
            "Samples per second: 20",
            "Sampling interval (ms): 50",
            "dt (s): 0.05",
            "odr (Hz): 20",
            "Acquisition rate: 20 Hz",
        ),
    ],
)
def test_a_rate_in_the_head_counts_the_rows(head: str, tmp_path: Path) -> None:
    _, rows = read(tmp_path / "a.csv", head + "\nax,ay,az\n" + "".join(f"{k % 7},{k % 3},9\n" for k in range(60)))
    np.testing.assert_allclose(np.diff(rows.time), 0.05, atol=1e-6)


def test_scales_in_the_head_of_a_log_for_gyroflow_are_applied() -> None:
    source = CsvSource(field_file("gyroflow.gcsv"))
    [rows] = source.rows()
    np.testing.assert_allclose(np.diff(rows.time), 0.002, atol=1e-6)
    assert rows.time[0] == UTC
    values, unit = rows.columns["gx"]
    assert (unit, np.abs(values).max()) == ("rad/s", pytest.approx(0.00122173 * 819))
    assert rows.columns["az"][1] == "g"
    assert rows.columns["az"][0][0] == pytest.approx(2048 * 0.000488281)


@each_row(
    ("name", "count", "rate", "units"),
    [
        ("aim_racestudio_padded.csv", 150, 20, {"GPS Speed": "km/h", "GPS Gyro": "deg/s"}),
        ("unit_row_one_unknown.csv", 5, 20, {"AccelX": "g", "Speed": "km/h", "Lap": ""}),
        ("tunerstudio.msl", 200, 20, {"AccelX": "g", "RPM": "RPM"}),
    ],
)
def test_tables_of_the_field_have_their_heads(name: str, count: int, rate: float, units: dict[str, str]) -> None:
    source = CsvSource(field_file(name))
    [rows] = source.rows()
    assert len(rows.time) == count
    np.testing.assert_allclose(np.diff(rows.time), 1 / rate, atol=1e-6)
    assert {key: rows.columns[key][1] for key in units} == units
    assert rows.time[0] == UTC or name.startswith("unit")
