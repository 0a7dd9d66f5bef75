"""Choices on how a file is read are kept beside it, and followed wherever it is opened."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import imuscope
from imuscope.recordings import sidecar
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.sidecar import Edits
from imuscope.recordings.tables.options import FileReading, TableOptions, over, reading_from
from imuscope.recordings.tables.table_source import CsvSource
from imuscope.server.cli import main
from tests.recordings.recorded_drive import drive

ROWS = 50
OPEN = "time,gx\n" + "".join(f"{n},{n}\n" for n in range(ROWS))


def lasts(path: Path, **options: str) -> float:
    """Duration of a file, s."""
    with imuscope.open(path, **options) as recording:
        return float(np.ptp(recording["gx"].time))


def test_an_open_unit_is_decided_by_the_sidecar(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(OPEN)
    with pytest.raises(RecordingError, match="can be s"):
        list(open_file(path).rows())  # type: ignore[attr-defined]
    sidecar.write(path, Edits(reading=FileReading(TableOptions(unit="ms"))))
    assert lasts(path) == pytest.approx((ROWS - 1) / 1000)
    assert lasts(path, time_unit="s") == pytest.approx(ROWS - 1)
    sidecar.write(path, Edits(title="walk").over(sidecar.read(path)))
    assert sidecar.read(path).reading == FileReading(TableOptions(unit="ms"))


def test_the_comment_of_an_exported_table_has_them_too(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    edits = Edits(reading=FileReading(TableOptions(unit="ms")))
    path.write_text(f"{sidecar.CSV_EDIT}{json.dumps(edits.as_metadata())}\n{OPEN}")
    assert lasts(path) == pytest.approx((ROWS - 1) / 1000)
    sidecar.write(path, Edits(reading=FileReading()))  # as the file itself says
    with pytest.raises(imuscope.ImuscopeError, match="can be s"):
        imuscope.open(path)


def test_another_column_is_the_axis_and_the_first_stays_a_clock(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{1_500_000_000 + n / 100:.2f},{n * 10_002},{n}\n" for n in range(ROWS))
    path.write_text(f"time (s),TimeUS,gx\n{rows}")
    sidecar.write(path, Edits(reading=FileReading(TableOptions(time_column="TimeUS"))))
    source = open_file(path)
    assert isinstance(source, CsvSource)
    assert source.axis is not None
    assert source.axis.name == "TimeUS"
    assert [one.name for one in source.axis.others] == ["time"]
    assert source.axis.options == {"TimeUS": "TimeUS", "time": "time (s)"}
    [rows_read] = source.rows()
    np.testing.assert_allclose(np.diff(rows_read.time), 0.010002, atol=1e-6)


def test_the_arrival_is_the_axis_of_a_device(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "drive.mcap"
    drive(path, seconds=1.0)

    def clocks(*options: str) -> dict[str, dict[str, object]]:
        assert main(["time", str(path), "--json", *options]) == 0
        message = json.loads(capsys.readouterr().out)["messages"][0]
        return {one["name"]: one for one in message["clocks"]}

    usual = clocks()
    assert (usual["time"]["is_axis"], usual["time"]["use"], usual["arrival"]["use"]) == (True, "device", "arrival")
    for chosen in (clocks("--clock", "arrival"), _choose_arrival(path) or clocks()):
        assert chosen["arrival"]["is_axis"]
        assert not chosen["time"]["is_axis"]
        assert chosen["time"]["use"] == "device"
        assert chosen["time"]["rate_hz"] == pytest.approx(usual["time"]["rate_hz"])
    assert clocks("--clock", "device")["time"]["is_axis"]
    with imuscope.open(path) as recording:
        signal = next(iter(recording))
        np.testing.assert_array_equal(signal.time, signal.arrival)


def _choose_arrival(path: Path) -> None:
    sidecar.write(path, Edits(reading=FileReading(clock="arrival")))


def test_a_strange_sidecar_chooses_nothing() -> None:
    strange = {"time_column": 3, "unit": "years", "rate": float("nan"), "columns": {"a": 1}, "clock": "sun"}
    assert reading_from(strange) == FileReading()
    assert reading_from([]) is None
    reading = FileReading(TableOptions("t", "ms", "dmy", 100.0, {"a": "b"}), "arrival")
    assert reading_from(json.loads(json.dumps(reading.as_json()))) == reading


def test_options_of_a_command_win() -> None:
    stored = TableOptions("t", "ms", "dmy", 0.0, {"a": "b"})
    assert over(TableOptions(), stored) == stored
    assert over(TableOptions(rate=100.0), stored) == TableOptions("t", "", "dmy", 100.0, {"a": "b"})
    assert over(TableOptions("u"), stored) == TableOptions("u", columns={"a": "b"})
