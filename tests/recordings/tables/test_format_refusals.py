"""Files that were refused for a false reason, or for none, and heads that were not read."""

from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.tables.table_source import CsvSource, TableSource
from tests.recordings.tables.field_files import field_file
from tests.recordings.tables.text_tables import read

VBO = """File created on 02/03/2026 at 10:00:00

[header]
satellites
time
latitude
longitude
yaw rate
lateral acc
lap

[channel units]
deg/s
g
(null)

[column names]
sats time lat long YawRate LatAcc Lap

[data]
"""


def test_units_of_the_channels_of_a_vbo_file_are_read(tmp_path: Path) -> None:
    rows = "\n".join(f"008 1000{n / 20:05.2f} +3119.{n:03} +58.{n:03} {n}.5 0.{n:02} 1" for n in range(1, 60))
    source, table = read(tmp_path / "a.vbo", VBO + rows + "\n")
    units = {name: unit for name, (_, unit) in table.columns.items()}
    assert (units["YawRate"], units["LatAcc"], units["Lap"], units["lat"]) == ("deg/s", "g", "", "")
    assert source.axis is not None
    assert 1 / source.axis.usual_s == pytest.approx(20)


@pytest.mark.parametrize(
    ("name", "rows", "rate"), [("ascii_text_named.mat", 200, 100), ("table_after_blank_head.dovex", 200, 25)]
)
def test_a_table_is_read_whatever_its_name_or_head(name: str, rows: int, rate: float) -> None:
    source = open_file(field_file(name))
    assert isinstance(source, TableSource)
    times = np.concatenate([one.time for one in source.rows()])
    assert len(times) == rows
    assert np.diff(times).mean() == pytest.approx(1 / rate)


@pytest.mark.parametrize("lines", [30, 500, 6000])
def test_blank_lines_of_a_head_are_counted(lines: int, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows_of_text = "".join(f"{n / 10},{n},0\n" for n in range(50))
    path.write_text("made by,a logger\n" + "\n" * lines + "time (s),x,y\n" + rows_of_text)
    [rows] = CsvSource(path).rows()
    np.testing.assert_array_equal(rows.columns["x"][0], np.arange(50))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("only_timestamps.csv", "only_timestamps.csv: X, Y, Z have no numbers."),
        ("gvret_can_savvycan.csv", "gvret_can_savvycan.csv is a CAN log of SavvyCAN"),
    ],
)
def test_a_refusal_names_its_cause(name: str, words: str) -> None:
    with pytest.raises(RecordingError) as caught:
        open_file(field_file(name))
    assert words in caught.value.message
    assert caught.value.hint


def test_a_text_is_not_taken_for_damaged_frames(tmp_path: Path) -> None:
    """A log in words was "frames of Xbus, all with a bad checksum"."""
    path = tmp_path / "a.log"
    path.write_text("".join(f"[{n}] motor \N{LATIN SMALL LETTER U WITH DIAERESIS}ok\n" for n in range(400)))
    with pytest.raises(RecordingError) as caught:
        open_file(path)
    assert "bad checksum" not in caught.value.message
