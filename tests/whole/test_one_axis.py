"""One axis for one stream: live, in its recording, in a file of its bytes, and exported and opened again."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import imuscope
from imuscope.live import Batch
from imuscope.protocols.arrays import Floats
from imuscope.signals import Signal
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

FAMILIES = {"xbus": "Acceleration", "isb": "DID_IMU.I.acc", "idtp": "Acceleration"}
RATE, SAMPLES = 50, 60
LATE_S = 2.0  # a recording begins later than the connection, and knows the device's clock from later arrivals
STEP_S = 1e-4


def test_a_stream_has_one_axis_live_recorded_and_exported(tmp_path: Path) -> None:
    sources = [f"sim:{family}?rate={RATE}" for family in FAMILIES]
    with ServerProcess(*sources, data=tmp_path / "data") as server, imuscope.connect(server.url) as live:
        block_until(
            lambda: all(one["status"] == "live" for one in server.request("GET", "/api/devices")), "all are live"
        )
        server.request("POST", "/api/recordings/start", {})
        batches: dict[tuple[str, str], list[Batch]] = {}
        for batch in live.stream(*{*FAMILIES.values()}, timeout_s=PATIENCE_S):
            batches.setdefault((batch.signal.device.id, batch.signal.name), []).append(batch)
            if len(batches) == len(FAMILIES) and min(sum(map(len, one)) for one in batches.values()) >= SAMPLES:
                break
        name = server.request("POST", "/api/recordings/stop")["id"]
    with imuscope.open(tmp_path / "data" / "recordings" / f"{name}.mcap") as recording:
        for (device, signal), parts in batches.items():
            [recorded] = [one for one in recording.signals if (one.device.id, one.name) == (device, signal)]
            assert parts[0].signal.units == recorded.units
            assert parts[0].signal.columns == recorded.columns
            assert_within(parts, recorded)
            [bytes_] = recording.export(tmp_path / f"{device}.bin", device=device)
            with imuscope.open(bytes_, protocol=recorded.device.protocol) as file:
                assert_same_stream(file[signal], recorded)
            [table] = recording.export(tmp_path / f"{device}.parquet", signals=f"{recorded.device.name}/{signal}")
            with imuscope.open(table) as again:
                [exported] = [one for one in again.signals if one.columns == recorded.columns]
                np.testing.assert_allclose(exported.time, recorded.time, atol=3e-7)  # of a table, in floats
                np.testing.assert_array_equal(exported.values.astype(recorded.values.dtype), recorded.values)
                assert exported.units == recorded.units


def step(time: Floats) -> float:
    """The usual one: a mapped clock may move when it is known better."""
    return float(np.median(np.diff(time)))


def assert_within(parts: Sequence[Batch], recorded: Signal) -> None:
    """The live samples are some of the recorded ones: all in a row, with their values, step and date."""
    values, time = (np.concatenate([getattr(part, name) for part in parts]) for name in ("values", "time"))
    known = {row.tobytes(): at for at, row in enumerate(recorded.values)}
    places = np.array([known.get(row.tobytes(), -1) for row in values])
    begin = int(np.flatnonzero(places < 0).max(initial=-1)) + 1  # some came just before it began
    rows, time = places[begin:], time[begin:]
    assert len(rows) > SAMPLES // 2
    assert (np.diff(rows) == 1).all() or sum(part.dropped for part in parts)
    np.testing.assert_allclose(recorded.time[rows], time, atol=LATE_S)
    assert step(recorded.time[rows]) == pytest.approx(1 / RATE, abs=STEP_S)
    assert step(time) == pytest.approx(1 / RATE, rel=0.1)  # its first second, as it was known then


def assert_same_stream(file: Signal, recorded: Signal) -> None:
    """A file of the bytes has the same samples at the same step; it has no date."""
    np.testing.assert_array_equal(file.values, recorded.values)
    assert step(file.time) == pytest.approx(step(recorded.time), abs=STEP_S)
    assert (file.units, file.columns, file.frame) == (recorded.units, recorded.columns, recorded.frame)
