"""A kept range: its chunks byte for byte, and the rows of the original."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import imuscope
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings import sidecar
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.recordings.sidecar import Edits, MarkerInfo
from tests.recordings.recorded_drive import START
from tests.support.each_row import each_row

SIMULATORS: Mapping[str, Any] = {"xbus": XbusSimulator, "isb": IsbSimulator, "idtp": IdtpSimulator}
BEGIN_S, END_S = 2.0, 3.5
CHUNK = 37  # bytes: most frames begin in one chunk and end in another


def whole(path: Path, family: str) -> Path:
    """A recording of six seconds in small chunks: a snapshot at its beginning, commands, markers."""
    device = SIMULATORS[family](start_ns=0) if family == "xbus" else SIMULATORS[family]()
    writer = McapWriter(path, {"title": "Yard loop"})
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": "921600", "protocol": family})
    writer.snapshot("1", {"values": {"rate": 100}, "missing": {}, "address": ""}, START)
    for n in range(1, 600):
        data, time = device.advance(n * 10_000_000), START + n * 10_000_000
        for at in range(0, len(data), CHUNK):
            writer.chunk("1", "rx", data[at : at + CHUNK], time + 10 * at)
        if n % 100 == 50:
            writer.chunk("1", "tx", bytes([n // 100]), time)
            writer.write_note("marker", f"at {n}", time)
    writer.close()
    return path


def chunks(path: Path, way: str = "rx") -> list[tuple[int, bytes]]:
    """Arrival and bytes of each chunk."""
    out = []
    for part in open_file(path).parts():
        begins = [0, *part.ends[:-1].tolist()]
        cuts = zip(part.times.tolist(), begins, part.ends.tolist(), strict=True)
        out += [(time, part.data[begin:end]) for time, begin, end in cuts if part.direction == way]
    return out


def rows(store: ColumnStore, span: tuple[int, int]) -> dict[str, Any]:
    """Of each signal the rows that arrived within a span: arrival, time, values."""
    out = {}
    for info in store.manifest["channels"]:
        exact = store.exact(info["id"], 0, store.rows(info["id"]))
        inside = (exact.arrival_ns >= span[0]) & (exact.arrival_ns <= span[1])
        if inside.any():
            out[f"{info['message']}/{info['name']}"] = [
                exact.arrival_ns[inside],
                exact.time_ns[inside],
                *(c[inside] for c in exact.columns),
            ]
    return out


def test_a_short_range_has_the_unit_that_the_whole_has_settled(tmp_path: Path) -> None:
    """A tenth of a second does not tell it; and a live event that names a unit without its option is no obstacle."""
    path, device = tmp_path / "ms.mcap", IdtpSimulator(tick_ns=1_000_000)
    writer = McapWriter(path, {})
    writer.device("1", {"link": "serial", "protocol": "idtp"})
    for n in range(1, 600):
        if data := device.advance(n * 10_000_000):
            writer.chunk("1", "rx", data, START + n * 10_000_000)
    live = {"kind": "device", "level": "warning", "text": "ms", "device": "1", "data": {"reason": "unit", "unit": "ms"}}
    writer.event(live, START)
    writer.close()
    original = imuscope.open(path)
    (made,) = original.export(tmp_path / "part.imuscope.mcap", begin_s=BEGIN_S, end_s=BEGIN_S + 0.1)
    assert open_file(made).devices["1"].identity["time_unit"] == "ms"
    assert imuscope.open(made)["RateOfTurn"].rate == pytest.approx(original["RateOfTurn"].rate, rel=0.05)


@each_row("family", list(SIMULATORS))
def test_its_chunks_are_those_of_the_range_and_its_rows_those_of_the_original(tmp_path: Path, family: str) -> None:
    path = whole(tmp_path / "whole.mcap", family)
    edits = Edits(tags=("yard",), notes="Three laps.", markers=(MarkerInfo(START / 1e9 + 3.2), MarkerInfo(START / 1e9)))
    sidecar.write(path, edits)
    with imuscope.open(path) as original:
        store = original._store
        begin = (store.span() or (0.0, 0.0))[0]
        request = ExportRequest(store, path, "Kerb", begin + BEGIN_S, begin + END_S)
        (made,) = export("recording", request, tmp_path / "part.imuscope.mcap")
        part = imuscope.open(made)
        ends = []
        for info in store.manifest["channels"]:
            lo, hi = store.between(info["id"], request.t0, request.t1)
            ends += store.clock_ns(info["id"], lo, hi, "arrival").tolist()
        span = min(ends), max(ends)
        expected, again = rows(store, span), rows(part._store, span)
    assert expected.keys() == again.keys()
    for name, columns in expected.items():
        apart = np.abs(columns[1] - again[name][1])
        assert apart.max() < 1e6, f"{name}: the clock is off by {apart.max() / 1e6} ms"
        for before, after in zip([columns[0], *columns[2:]], [again[name][0], *again[name][2:]], strict=True):
            np.testing.assert_array_equal(before, after, name)
    # byte for byte, and no more before it than the beginning of a frame and what describes the device
    inside = [one for one in chunks(path) if span[0] <= one[0] <= span[1]]
    mine = chunks(made)
    assert mine[-len(inside) :] == inside
    lead = b"".join(data for _, data in mine[: -len(inside)])
    assert len(lead) < 600
    assert part._store.manifest["figures"]["1"]["rejects"] == 0
    assert [time for time, _ in chunks(made, "tx")] == [
        time for time, _ in chunks(path, "tx") if span[0] <= time <= span[1]
    ]
    # what is beside the bytes
    assert next(iter(part._store.manifest["snapshots"].values()))["values"] == {"rate": 100}
    stored = sidecar.from_metadata(open_file(made)._recording.meta("edit"))  # type: ignore[attr-defined]
    assert stored.tags == ("yard",)
    assert [marker.time for marker in stored.markers] == [START / 1e9 + 3.2]
    first, second, _, own = (stored.notes or "").split("\n")
    assert (first, own) == ("00:02.000 to 00:03.500 of Yard loop.", "Three laps.")
    assert second.startswith("whole.mcap, 2025-10-09 08:53:2")


def test_a_capture_is_kept_with_the_times_derived_for_it(tmp_path: Path) -> None:
    path = tmp_path / "run.bin"
    path.write_bytes(b"".join(data for _, data in chunks(whole(tmp_path / "whole.mcap", "xbus"))))
    original = imuscope.open(path)
    (made,) = original.export(tmp_path / "part.imuscope.mcap", begin_s=BEGIN_S, end_s=END_S)
    mine = b"".join(data for _, data in chunks(made))
    assert mine in path.read_bytes()
    part = imuscope.open(made)
    name = original.signals[0].name
    assert abs(len(part[name]) - (END_S - BEGIN_S) * original[name].rate) <= 2


def test_a_table_has_no_bytes_to_keep(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("time (s),gyr_x (rad/s)\n" + "\n".join(f"{k / 100},{k}.5" for k in range(300)) + "\n")
    with pytest.raises(imuscope.ImuscopeError, match="numbers"):
        imuscope.open(path).export(tmp_path / "part.imuscope.mcap", begin_s=1.0)
