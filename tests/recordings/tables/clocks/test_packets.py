"""Packets: rows that share a time are spread over it; times that lost their digits are refused."""

import json
from pathlib import Path

import numpy as np
import pytest

import imuscope
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.table_source import CsvSource, TableSource
from tests.recordings.tables.field_files import field_file
from tests.recordings.tables.text_tables import read

N, SIZE, STEP = 400, 8, 0.01
START = 1_772_445_600


def _packets(heading: str, late: float = 0.0, of_last: bool = False) -> str:
    """Rows of packets with one time each, s since 1970, of the first or the last sample."""
    stamps = [START + ((n // SIZE + of_last) * SIZE - of_last) * STEP + late for n in range(N)]
    return "\n".join([f"{heading},x,y,z", *(f"{one:.3f},{n % 7},0,9" for n, one in enumerate(stamps))])


@pytest.mark.parametrize(
    ("heading", "late", "stamp", "of_last"),
    [
        ("timestamp", 0.0, "", False),
        ("timestamp", 0.0, "last", True),
        ("Phone timestamp", 0.003, "", True),
        ("received_time", 0.003, "", True),
        ("received_time", 0.003, "first", False),
    ],
)
def test_samples_of_a_packet_are_spread_over_it(
    heading: str, late: float, stamp: str, of_last: bool, tmp_path: Path
) -> None:
    table = _packets(heading, late, of_last)
    source, rows = read(tmp_path / "a.csv", table, TableOptions(packet_stamp=stamp))  # type: ignore[arg-type]
    np.testing.assert_allclose(rows.time - START - late, np.arange(N) * STEP, atol=1e-6)
    assert source.axis is not None
    end = "last" if of_last else "first"
    assert f"8 rows share each time of {heading}: they are spread over the packet, whose {end} sample has it" in (
        " ".join(source.axis.sentences())
    )
    assert len(rows.columns[heading][0]) == N  # the times of the file stay a column


def test_the_library_takes_the_end_of_a_packet(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(_packets("timestamp", of_last=True))
    with imuscope.open(path, packet_stamp="last") as opened:
        np.testing.assert_allclose(opened["xyz"].time - START, np.arange(N) * STEP, atol=1e-6)


def test_whole_seconds_are_spread_from_where_the_first_one_was_entered(tmp_path: Path) -> None:
    lines = [f"{int(START + 0.63 + n * STEP)},{n % 7},0,9" for n in range(N)]
    _, rows = read(tmp_path / "a.csv", "\n".join(["timestamp,x,y,z", *lines]))
    np.testing.assert_allclose(rows.time - START - 0.63, np.arange(N) * STEP, atol=1e-5)


def test_a_pause_between_packets_stays_a_pause(tmp_path: Path) -> None:
    lines = [f"{START + n // SIZE * SIZE * STEP + 5 * (n >= 200):.3f},{n % 7},0,9" for n in range(N)]
    _, rows = read(tmp_path / "a.csv", "\n".join(["timestamp,x,y,z", *lines]))
    true = np.arange(N) * STEP + 5 * (np.arange(N) >= 200)
    np.testing.assert_allclose(rows.time - START, true, atol=1e-5)


def test_packets_go_on_over_the_blocks_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imuscope.recordings.tables.number_blocks.BLOCK_BYTES", 1 << 10)
    path = tmp_path / "a.csv"
    path.write_text(_packets("timestamp"))
    times = np.concatenate([rows.time for rows in CsvSource(path).rows()])
    np.testing.assert_allclose(times - START, np.arange(N) * STEP, atol=1e-6)


def test_rows_of_several_sensors_at_one_time_are_not_spread(tmp_path: Path) -> None:
    lines = [f"{START + n // SIZE * STEP:.3f},{n % SIZE},{n % 5},9" for n in range(N)]
    _, rows = read(tmp_path / "a.csv", "\n".join(["timestamp,marker,x,y", *lines]))
    np.testing.assert_allclose(rows.time - START, np.arange(N) // SIZE * STEP, atol=1e-6)


def test_packets_of_the_field_have_all_their_samples() -> None:
    source = open_file(field_file("movesense_packets.json"))
    assert isinstance(source, TableSource)
    [rows] = source.rows()
    np.testing.assert_allclose(np.diff(rows.time), 1 / 104, atol=2e-4)  # stamps in ms
    axes = [values for name, (values, _) in rows.columns.items() if name.endswith((".x", ".y", ".z"))]
    assert [len(one) for one in axes] == [320] * 3


@pytest.mark.parametrize("nested", [True, False])
def test_packets_in_lines_of_json_have_all_their_samples(nested: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    packets = [
        {"Timestamp": 5000 + 80 * n, "Acc": [{"x": n * SIZE + i, "y": 0, "z": 9} for i in range(SIZE)]}
        for n in range(N // SIZE)
    ]
    path.write_text("".join(f"{json.dumps({'acc': one} if nested else one)}\n" for one in packets))
    source = open_file(path)
    assert isinstance(source, TableSource)
    [rows] = source.rows()
    [x] = [values for name, (values, _) in rows.columns.items() if name.endswith(".x")]
    np.testing.assert_array_equal(x, np.arange(N))
    np.testing.assert_allclose(np.diff(rows.time), STEP, atol=1e-6)


@pytest.mark.parametrize("unit", ["", "ms", "us"])
def test_times_without_their_digits_are_refused(unit: str) -> None:
    with pytest.raises(RecordingError) as caught:
        list(CsvSource(field_file("m2ud_times_rounded_to_six_digits.csv"), TableOptions(unit=unit)).rows())
    assert "300 rows have 2 different times in time, written with 6 digits" in caught.value.message


@pytest.mark.parametrize("cell", ["0", "1.5", "1772445600"])
def test_a_clock_that_stands_is_refused(cell: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as caught:
        read(tmp_path / "a.csv", "\n".join(["time,x,y,z", *(f"{cell},{n % 7},0,9" for n in range(N))]))
    assert "400 rows all have the same time in time" in caught.value.message
