"""Every frame of the device captures decodes to the values of the vendor's reader, line by line."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap
from imuscope.protocols.xbus.data_identifiers import ITEMS
from imuscope.protocols.xbus.decoder import XbusDecoder
from tests.protocols.decoding import decode_chunks
from tests.protocols.xbus.xbus_vectors import GOLDEN, flat
from tests.support.each_row import each_row

NAMES = {row.id: row.name for row in ITEMS}
CAPTURES = ("mti_100hz_49s", "mti_float32", "mti_float32_satinfo_ecef")


def decode(data: bytes, chunk: int = 1000) -> list[Event]:
    return decode_chunks(XbusDecoder(), ((at, data[at : at + chunk]) for at in range(0, len(data), chunk)))


def capture(captures: Path, name: str) -> tuple[list[Event], list[dict[str, Any]]]:
    """What is decoded of a capture, and the values of the vendor's reader."""
    data = captures / "xbus" / f"{name}.bin"
    if not data.is_file():
        pytest.skip(f"no capture {data.name}")
    expected = data.with_suffix(".expected.jsonl").read_text().splitlines()
    return decode(data.read_bytes()), [json.loads(line) for line in expected]


@each_row("name", CAPTURES)
def test_line_by_line(name: str, captures: Path) -> None:
    events, lines = capture(captures, name)
    rows = {int(o): (batch, i) for batch in events if isinstance(batch, Batch) for i, o in enumerate(batch.offset)}
    assert sorted(rows) == [line["offset"] for line in lines]
    for line in lines:
        batch, row = rows[line["offset"]]
        assert [f"{field.id & 0xFFF0:04X}" for field in batch.message.fields] == line["ids"]
        for key, expected in line.items():
            if len(key) != 4 or key in ("mid", "ids"):
                continue
            compare(batch.columns[NAMES[int(key, 16)]][row], expected)


def compare(got: Any, expected: Any) -> None:
    if isinstance(expected, dict):
        scales = {"lon": 1e7, "lat": 1e7, "headMot": 1e5, "edop": 100}
        for name, value in expected.items():
            assert got[name] == value / scales.get(name, 1), name
        return
    target = flat(expected)
    for one, other in zip(flat(got.tolist()), target, strict=True):
        assert one == other or math.isclose(one, other, rel_tol=2**-23)


@each_row("name", CAPTURES)
def test_time_and_loss(name: str, captures: Path) -> None:
    """Device time is SampleTimeFine in ns, also for GNSS messages with an older one; nothing is lost."""
    events, lines = capture(captures, name)
    for batch in events:
        if isinstance(batch, Batch):
            if batch.time_ns is None:  # without a reported fix, the clock of a GNSS message is arbitrary
                assert batch.message.fields[0].name in ("GnssPvtData", "GnssSatInfo")
                continue
            assert np.array_equal(batch.time_ns, batch.columns["SampleTimeFine"].astype(np.int64) * 100_000)
    counters = [line["1020"] for line in lines]
    lost = sum((b - a - 1) % 65536 for a, b in pairwise(counters))
    assert sum(event.missing for event in events if isinstance(event, SampleGap)) == lost
    assert not [event for event in events if isinstance(event, (RejectedFrame, ClockStep))]


def test_file_of_the_vendors_program() -> None:
    """An .mtb file: Configuration, the device's stored calibration, data."""
    events = decode((GOLDEN / "sample.mtb").read_bytes())
    names = [event.message.name for event in events if isinstance(event, (Reply, Batch))]
    assert names[:2] == ["Configuration", "EmtsData"]
    assert "MTData2" in names
    assert not [event for event in events if isinstance(event, RejectedFrame)]
