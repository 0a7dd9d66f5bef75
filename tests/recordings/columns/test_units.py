"""Values as they arrived: stored bit by bit, and converted only where they are read."""

import csv
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import imuscope
from imuscope.protocols.arrays import Array
from imuscope.recordings.columns.units import UNITS, Units
from imuscope.recordings.mcap.writer import McapWriter
from tests.recordings import every_message
from tests.recordings.recorded_drive import START, drive
from tests.support.each_row import each_row

RATE_OF_TURN = 0x8020
MESSAGES: Mapping[str, Callable[[], Iterator[every_message.Case]]] = {
    "xbus": every_message.xbus,
    "idtp": every_message.idtp,
    "isb": every_message.isb,
}
SENT = {"xbus": {"mm", "mm/s", "rad/s"}, "idtp": {"rad/s"}, "isb": {"rad", "rad/s"}}


def sent(data: bytes) -> Array:
    """(n, 3) float32, rad/s: the rates of turn in the bytes of an MTi."""
    rows, at = [], 0
    while at < len(data):
        size = data[at + 3]
        item, end = at + 4, at + 4 + size
        while data[at + 2] == 0x36 and item < end:
            if struct.unpack_from(">H", data, item)[0] == RATE_OF_TURN:
                rows.append(struct.unpack_from(">3f", data, item + 3))
            item += 3 + data[item + 2]
        at = end + 1
    return np.array(rows, np.float32)


def test_what_arrived_is_in_the_recording_and_its_exports_bit_by_bit(tmp_path: Path) -> None:
    """Regression: float32 rad/s were stored as float32 °/s, and their last digits were lost."""
    wire = sent(drive(tmp_path / "a.mcap", seconds=2.0))
    assert len(wire) > 100
    with imuscope.open(tmp_path / "a.mcap") as recording:
        rate = recording["RateOfTurn"]
        np.testing.assert_array_equal(rate.in_units("device").values, wire)
        np.testing.assert_array_equal(rate.in_units("SI").values, wire)
        np.testing.assert_array_equal(rate.values, (wire * (180 / np.pi)).astype(np.float32))
        np.testing.assert_array_equal(rate.values_in("rad/s"), wire.astype(np.float64))
        frame = recording.to_pandas("RateOfTurn", units="device")
        assert frame.attrs["units"] == dict.fromkeys(("RateOfTurn.x", "RateOfTurn.y", "RateOfTurn.z"), "rad/s")
        np.testing.assert_array_equal(frame.to_numpy(), wire)
        [parquet] = recording.export(tmp_path / "rates.parquet", signals="RateOfTurn", units="device")
        [text] = recording.export(tmp_path / "rates.csv", signals="RateOfTurn", units="SI")
        with pytest.raises(imuscope.ImuscopeError, match="files have units of their own"):
            recording.export(tmp_path / "rates.euroc", units="SI")
        [decoded] = recording.export(tmp_path / "rates.mcap", units="device")
        [angles] = recording.export(tmp_path / "angles.mcap", units="SI")
        roll = recording["EulerAngles"].values_in("rad")
    with imuscope.open(angles) as again:
        names = [one.message for one in again.signals]
        np.testing.assert_array_equal(again.signals[names.index("/MTi-630/Euler_angles")].values, roll)
        rotation = again["rotation"].values
    with imuscope.open(decoded) as again:
        np.testing.assert_array_equal(again["rotation"].values, rotation)
        np.testing.assert_array_equal(again["Rate of turn"].in_units("device").values.astype(np.float32), wire)
    table = pq.read_table(parquet)
    for at, axis in enumerate("xyz"):
        np.testing.assert_array_equal(table[f"RateOfTurn.{axis}"].to_numpy(), wire[:, at])
        assert table.schema.field(f"RateOfTurn.{axis}").metadata[b"unit"] == b"rad/s"
    with text.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_array_equal(np.array([row["RateOfTurn.x (rad/s)"] for row in rows], np.float32), wire[:, 0])


@each_row("family", MESSAGES)
def test_every_converted_column_is_as_sent_in_the_units_of_the_device(family: str, tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap", {"title": family})
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921600, "protocol": family})
    for number, (_, frame) in enumerate(MESSAGES[family](), 1):
        writer.chunk("1", "rx", frame, START + number * 10_000_000)
    writer.close()
    units = set()
    with imuscope.open(tmp_path / "a.mcap", protocol=family) as recording:
        for signal in recording.signals:
            shown, si, device = (signal.in_units(one) for one in UNITS)
            assert len(shown.columns) == len(device.columns) == len(si.columns)
            for at in range(len(signal.columns)):
                values, own = shown.column(at), device.column(at)
                if shown.units[at] == device.units[at]:
                    np.testing.assert_array_equal(values, own)
                    continue
                units.add(device.units[at])
                if device.units[at].startswith("rad"):
                    assert own.dtype in (np.float32, np.float64)
                    np.testing.assert_array_equal(values, own * (180 / np.pi))
                if device.units[at].startswith("mm"):
                    assert (own == np.rint(own)).all()
                    np.testing.assert_array_equal(values, own / 1000)
                    np.testing.assert_allclose(si.column(at), values)
    assert units >= SENT[family]


@each_row("units", UNITS)
def test_a_summary_of_many_rows_is_that_of_the_converted_ones(units: Units, tmp_path: Path) -> None:
    drive(tmp_path / "a.mcap", seconds=8.0)
    with imuscope.open(tmp_path / "a.mcap") as recording:
        store = recording._store.in_units(units)
        number = recording["RateOfTurn"]._channel
        exact = store.exact(number, 0, store.rows(number)).columns
        begin, end = store.span(number) or (0.0, 0.0)
        buckets = store.query(number, begin, end, 4)
        assert [float(one.min()) for one in exact] == [float(one.min()) for one in buckets.low]
        assert [float(one.max()) for one in exact] == [float(one.max()) for one in buckets.high]
