"""Rows of packets: one for each, whatever fields it has, however the recording is divided into windows."""

from __future__ import annotations

import tempfile
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from hypothesis import example, given
from hypothesis import strategies as st

from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.server.extensions.fleet.store import samples
from imuscope.server.extensions.fleet.store.metadata import RecordingKey
from imuscope.server.extensions.fleet.store.packet_rows import packet_windows
from tests.recordings.store_fixtures import START, channel, column

QUANTITIES = ("Acceleration", "MagneticField", "BaroPressure")


class Packet(NamedTuple):
    """A packet: its arrival and time, s after the start, and how many values it has of each quantity."""

    arrival: float
    time: float
    values: tuple[int, ...]


def opened(folder: Path, packets: list[Packet], infos: list[dict[str, Any]]) -> ColumnStore:
    """A store with these packets; every value is the number of its packet."""
    writer = ColumnStoreWriter(folder / "columns")
    for at, info in enumerate(infos):
        writer.channel(info["id"], ChannelLayout(("f8",), (False,)))
        rows = [
            (START + one.arrival, START + one.time, n) for n, one in enumerate(packets) for _ in range(one.values[at])
        ]
        writer.append(info["id"], list(np.array(rows, float).reshape(-1, 3).T))
    return writer.finish({"channels": infos})


def quantity(number: int, name: str, kind: str = "scalar", unit: str = "", doc: str = "") -> dict[str, Any]:
    one = {**column("value", "f8", unit), "choices": {}, "decimals": 1, "period": 0.0}
    return channel(number, "1", "MTData2", name, kind, [one], doc=doc)


def rows_of(packets: list[Packet], *infos: dict[str, Any]) -> list[dict[str, Any]]:
    """The rows of `samples`: what they have besides the recording."""
    with tempfile.TemporaryDirectory() as folder:
        store = opened(Path(folder), packets, list(infos))
        groups = samples.sample_rows(store)
        schema = samples.sample_schema(groups, None)
        key = RecordingKey(date(2025, 10, 9), "otter", "a")
        rows: pa.Table = samples.sample_reader(store, groups, key, schema).read_all()
    return [{name: row[name] for name in schema.names[4:]} for row in rows.to_pylist()]


SIMPLE = st.tuples(*[st.integers(0, 1)] * len(QUANTITIES)).filter(any)
STEPS = st.lists(st.tuples(st.sampled_from([0.0, 0.01, 0.3, -0.5]), SIMPLE), min_size=1, max_size=40)


@given(STEPS, st.integers(1, 7))
@example([(0.0, (1, 1, 0))] * 9 + [(0.01, (0, 0, 1))] * 9, 1)
def test_a_packet_is_one_row_in_windows_of_any_size(steps: list[tuple[float, tuple[int, ...]]], size: int) -> None:
    """Chunks have several packets; the host's clock may step back; a clock of the device tells packets apart."""
    arrival, packets = 0.0, []
    for n, (step, values) in enumerate(steps):
        arrival += step
        packets.append(Packet(arrival, 0.01 * n, values))
    infos = [quantity(n, name) for n, name in enumerate(QUANTITIES, 1)]
    with tempfile.TemporaryDirectory() as folder:
        store = opened(Path(folder), packets, infos)
        results: dict[int, list[set[int]]] = {}
        rows = 0
        for window in packet_windows(store, [[one] for one in (1, 2, 3) if store.rows(one)], size):
            assert (np.diff(window.time) >= 0).all()
            for number, (lo, hi, at) in window.samples.items():
                for value, row in zip(store.exact(number, lo, hi).columns[0], at, strict=True):
                    results.setdefault(rows + int(row), []).append({int(value), -number})
            rows += len(window.time)
    assert rows == len(packets)
    assert sorted(results) == list(range(rows))
    for parts in results.values():
        (packet,) = {value for part in parts for value in part if value >= 0}
        assert len(parts) == sum(packets[packet].values)


def test_a_packet_with_optional_fields_was_several_rows() -> None:
    packets = [Packet(0.01 * n, 0.01 * n, (1, int(n % 4 == 0), int(n % 8 == 0))) for n in range(16)]
    rows = rows_of(packets, *(quantity(n, name) for n, name in enumerate(QUANTITIES, 1)))
    assert [row["Acceleration_value"] for row in rows] == list(range(16))
    assert [row["MagneticField_value"] for row in rows] == [n if n % 4 == 0 else None for n in range(16)]
    assert [row["BaroPressure_value"] for row in rows] == [n if n % 8 == 0 else None for n in range(16)]
    assert {row["entry"] for row in rows} == {None}


def test_packets_without_a_clock_that_arrived_at_once_stay_apart() -> None:
    rows = rows_of([Packet(0.0, np.nan, (1, 0, 0))] * 3, quantity(1, "Acceleration"))
    assert [row["Acceleration_value"] for row in rows] == [0, 1, 2]
    assert len({row["time"] for row in rows}) == 1


def test_entries_of_a_list_have_rows_of_their_own_with_their_number() -> None:
    packets = [Packet(0.1 * n, 0.1 * n, (1, n)) for n in range(3)]
    rows = rows_of(packets, quantity(1, "Acceleration"), quantity(2, "GnssSatInfo", "table"))
    assert [row["Acceleration_value"] for row in rows if row["entry"] is None] == [0, 1, 2]
    satellites = [(row["GnssSatInfo_value"], row["entry"]) for row in rows if row["entry"] is not None]
    assert satellites == [(1, 1), (2, 1), (2, 2)]


def test_a_quantity_whose_unit_changed_shares_rows_with_the_others() -> None:
    packets = [Packet(0.1 * n, 0.1 * n, (1, int(n < 2), int(n >= 2))) for n in range(4)]
    changed = quantity(2, "MagneticField", unit="a.u."), quantity(3, "MagneticField", unit="µT")
    rows = rows_of(packets, quantity(1, "Acceleration"), *changed)
    assert [(row["MagneticField_value"], row["MagneticField_value_2"]) for row in rows] == [
        (0, None),
        (1, None),
        (None, 2),
        (None, 3),
    ]


def test_angles_of_two_attitudes_of_a_packet_have_columns_of_their_own() -> None:
    angles = [quantity(n, "EulerAngles", "euler", "°", f"Computed from {n}") for n in (1, 2)]
    rows = rows_of([Packet(0.1 * n, 0.1 * n, (1, 1)) for n in range(3)], *angles)
    assert [(row["EulerAngles_value"], row["EulerAngles_2_value"]) for row in rows] == [(0, 0), (1, 1), (2, 2)]
