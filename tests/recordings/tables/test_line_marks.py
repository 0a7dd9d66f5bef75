"""Rows with marks around their cells (Arduino's serial monitor, WISDM), and tables whose times nothing names."""

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.table_preview import preview_of
from imuscope.recordings.tables.format import format_of
from imuscope.recordings.tables.line_marks import LineMarks
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.utf8 import Utf8
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.support.each_row import each_row

N = 200
WEEK, TOW = 2190, 346_000.0
BEGIN = 315_964_800 + WEEK * 604_800 + TOW - 18


def opened(path: Path, options: TableOptions | None = None) -> ColumnStore:
    return decode(open_file(path, "", options), path.with_suffix(".columns"), protocol_set.all_protocols())


def stamp(n: int) -> str:
    ms = 36_900_000 + 10 * n
    return f"{ms // 3_600_000:02}:{ms // 60_000 % 60:02}:{ms // 1000 % 60:02}.{ms % 1000:03}"


@each_row(
    ("head", "row", "names"),
    [
        ("", "1.5,{n},9.8", ["column 2", "column 3", "column 4"]),
        ("", "1.5\t{n}\t9.8", ["column 2", "column 3", "column 4"]),
        ("", "1.5 {n} 9.8", ["column 2", "column 3", "column 4"]),
        ("", "1.5;{n};9.8;", ["column 2", "column 3", "column 4"]),
        ("", "1.5,{n},9.8;", ["column 2", "column 3", "column 4"]),
        ("", "{n}", ["column 2"]),
        ("MPU6050 ready\nax,n,az\n", "1.5,{n},9.8", ["ax", "n", "az"]),
    ],
)
def test_stamps_of_a_serial_monitor_are_times_of_day(head: str, row: str, names: list[str], tmp_path: Path) -> None:
    lines = [*head.splitlines(), *(row.format(n=n) for n in range(N))]
    path = tmp_path / "monitor.txt"
    path.write_text("".join(f"{stamp(n)} -> {line}\r\n" for n, line in enumerate(lines)))
    store = opened(path)
    [info, *_] = [one for one in store.manifest["channels"] if one["name"] in ("n", "column 2", "column 3")][-1:]
    rows = store.exact(info["id"], 0, 10 * N)
    np.testing.assert_array_equal(rows.columns[0], np.arange(N))
    np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-6)
    begin = 36_900 + 0.01 * (len(lines) - N)
    assert rows.time[0] % 86_400 == pytest.approx(begin, abs=1e-5)
    assert [one["name"] for one in store.manifest["channels"]] == names
    assert store.manifest["damage"] == []


def test_a_mark_at_the_end_of_rows_is_left_out_and_the_time_is_requested(tmp_path: Path) -> None:
    path = tmp_path / "WISDM_raw.txt"
    times = 49_105_962_326_000 + 50_000_000 * np.arange(N)
    path.write_text("".join(f"33,Jogging,{at},-0.69,{n},0.5;\n" for n, at in enumerate(times)))
    with pytest.raises(RecordingError, match="no column of times") as refused:
        open_file(path)
    assert "rising from row to row: column 3, 5." in refused.value.hint
    assert "--time-column 3" in refused.value.hint
    store = opened(path, TableOptions(time_column="3", columns={"2": ""}))
    values = {one["name"]: store.exact(one["id"], 0, 10 * N) for one in store.manifest["channels"]}
    np.testing.assert_array_equal(values["column 6"].columns[0], np.full(N, 0.5))
    np.testing.assert_allclose(np.diff(values["column 5"].time), 0.05, atol=1e-6)
    assert store.manifest["damage"] == []


@each_row("line", ["1;2;3;", "1;2", "a;b;", "1,2;3;", "1,2"])
def test_a_semicolon_that_separates_is_kept(line: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{line}\n" * 9)
    try:
        marks = format_of(path).marks
    except RecordingError:
        return
    assert not marks


@each_row("separator", [",", " ", "\t"])
def test_a_gps_week_without_a_heading_is_named_and_not_guessed(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "imu.txt"
    rows = ([f"{WEEK}", f"{TOW + n / 200:.3f}", "0.001", "-0.002", "9.81"] for n in range(N))
    path.write_text("".join(separator.join(row) + "\n" for row in rows))
    with pytest.raises(RecordingError, match="no column of times") as refused:
        open_file(path)
    assert "columns 1 and 2 look like a GPS week and the seconds of it" in refused.value.hint
    assert '"1 = week" and "2 = tow (s)"' in refused.value.hint
    named = TableOptions(columns={"1": "week", "2": "tow (s)"})
    previews = [preview_of(path, one) for one in (TableOptions(), named)]
    assert [(one.about, one.clock) for one in previews if one] == [("time", ""), ("", "week + tow")]
    store = opened(path, named)
    time = store.exact(store.manifest["channels"][0]["id"], 0, 10 * N).time
    np.testing.assert_allclose(time, BEGIN + np.arange(N) / 200, atol=1e-5)


@each_row("first", ["7", "99999", "2190.5"])
def test_other_numbers_are_no_gps_week(first: str, tmp_path: Path) -> None:
    path = tmp_path / "imu.txt"
    path.write_text("".join(f"{first},{TOW + n / 200:.3f},0.001,-0.002,9.81\n" for n in range(N)))
    with pytest.raises(RecordingError, match="no column of times") as refused:
        open_file(path)
    assert "rising from row to row: column 2." in refused.value.hint


@given(st.integers(1, 40), st.sampled_from([LineMarks(",", has_end=True), LineMarks(has_end=True), LineMarks()]))
def test_pieces_of_a_file_give_the_same_lines(size: int, marks: LineMarks) -> None:
    text = "".join(f"{stamp(n)} -> {n},2;\r\n" for n in range(9)) + "10:15:01 -> 4;"
    reader = Utf8(io.BytesIO(text.encode()), [], marks)
    pieces = iter(lambda: reader.read(size), b"")
    assert b"".join(pieces).decode() == marks.removed(text)
