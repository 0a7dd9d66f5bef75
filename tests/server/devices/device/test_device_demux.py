"""Complete captures of real devices through decoder, ingest and store, for any chunk boundaries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.server import wire
from imuscope.server.devices.device.device_demux import LinkDecoder, LinkDevices
from imuscope.server.devices.device.device_state import DeviceState
from imuscope.server.devices.device.ingest import LinkTiming
from imuscope.server.devices.device.link_stats import LinkStatistics
from imuscope.server.links.base import Chunk
from imuscope.server.streaming.telemetry import Telemetry
from tests.support.each_row import each_row
from tests.support.fakes import FakeClock

RATE = 7_730  # bytes/s: nominal rate of the chunks; that of the 49 s capture


def play(path: Path, chunk: int) -> tuple[Telemetry, LinkStatistics]:
    clock = FakeClock()
    telemetry = Telemetry.create(clock)
    info = wire.DeviceInfo("1", "capture", str(path), "file", "live")
    senders = LinkDevices(telemetry.bus, DeviceState(telemetry.bus, info, str), str)
    intake = LinkDecoder(telemetry.bus, senders, XbusDecoder(), line=LinkTiming(10e9 / 115_200, "serial"))
    data = path.read_bytes()
    for at in range(0, len(data), chunk):
        clock.move(chunk / RATE)
        intake.feed(Chunk(data[at : at + chunk], clock.ns))
        intake.drain()
    intake.drain(stalled=True)
    return telemetry, senders.own.stats


def columns(telemetry: Telemetry, name: str) -> dict[str, Any]:
    channel = next(one for one in telemetry.store.all if one.info.name == name)
    names = ["arrival", "time", *(column.name for column in channel.info.columns)]
    return dict(zip(names, channel.ring.read(), strict=True))


def test_layouts_that_alternate_stay_in_order(captures: Path) -> None:
    """mti_100hz_49s.bin mixes inertial frames and GNSS solutions, which carry no acceleration but the same counter."""
    telemetry, figures = play(captures / "xbus" / "mti_100hz_49s.bin", 4096)
    counter = columns(telemetry, "PacketCounter")["value"].astype(int)
    assert (np.diff(counter) % 65536 == 1).all()
    assert figures.gaps == figures.rejects == 0
    assert figures.messages["MTData2"].total == len(counter)
    acceleration = columns(telemetry, "Acceleration")
    assert len(acceleration["x"]) < len(counter)
    assert (np.diff(acceleration["time"]) > 0).all()
    assert np.median(np.diff(acceleration["time"])) == pytest.approx(0.01, rel=0.05)


@each_row("chunk", [64, 1000, 100_000])
def test_chunks_do_not_matter(captures: Path, chunk: int) -> None:
    path = captures / "xbus" / "mti_float32.bin"
    whole, _ = play(path, 10**9)
    cut, _ = play(path, chunk)
    assert [one.info.name for one in whole.store.all] == [one.info.name for one in cut.store.all]
    for channel in whole.store.all:
        for expected, got in zip(channel.ring.read()[2:], cut.store.of(channel.info.id).ring.read()[2:], strict=True):
            np.testing.assert_array_equal(expected, got)


def test_satellites_are_a_table(captures: Path) -> None:
    telemetry, _ = play(captures / "xbus" / "mti_float32_satinfo_ecef.bin", 2048)
    channel = next(one for one in telemetry.store.all if one.info.name == "GnssSatInfo")
    assert channel.info.kind == "table"
    table = columns(telemetry, "GnssSatInfo")
    assert {"svId", "cno"} <= table.keys()
    times = np.unique(table["arrival"])
    assert 0 < len(times) < len(table["arrival"])
    assert table["cno"].max() < 64
