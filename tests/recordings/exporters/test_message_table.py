"""Rows of one packet stay together in a table, with or without a device time."""

import csv
import struct
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.support.truth_frames import opened, xbus

NO_FIX = 90  # bytes of a GnssPvtData after its time of week; of type "no fix", so that the packet has no device time


def frames() -> Iterator[bytes]:
    """Packets of which each 25th and the one after it are solutions of a receiver, numbered like their packet."""
    for number in range(1000):
        if number % 25 in (10, 11):
            pvt = struct.pack(f">I{NO_FIX}x", number)
            yield xbus(number, 100 * number, (0x7010, f"{len(pvt)}B", tuple(pvt)))
        else:
            yield xbus(number, 100 * number)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_solution_stands_on_the_row_of_its_packet(tmp_path: Path, suffix: str) -> None:
    """Regression: a solution without a device time stood on the row of the packet before it, 2.49 s off."""
    with opened(tmp_path / "a.bin", b"".join(frames())) as recording:
        assert len(recording["GnssPvtData"]) == 80
        [path] = recording.export(tmp_path / f"b{suffix}")
    if suffix == ".csv":
        with path.open(encoding="utf-8") as file:
            rows = [(row["PacketCounter"], row["GnssPvtData.itow (ms)"]) for row in csv.DictReader(file)]
        numbers = [(int(number), int(itow)) for number, itow in rows if itow]
    else:
        table = pq.read_table(path)
        columns = table.column("PacketCounter").to_pylist(), table.column("GnssPvtData.itow").to_pylist()
        rows = list(zip(*columns, strict=True))
        numbers = [(number, itow) for number, itow in rows if itow is not None]
    assert len(rows) == 1000
    assert numbers == [(number, number) for number in range(1000) if number % 25 in (10, 11)]
