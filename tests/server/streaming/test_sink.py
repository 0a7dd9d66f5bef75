"""The telemetry sink interface: a live bus, the store of a recording and other sinks receive the same data."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.events import Decoder
from imuscope.protocols.idtp.decoder import IdtpDecoder
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.columns.health_history import HealthHistoryWriter
from imuscope.recordings.columns.store import ColumnStoreWriter
from imuscope.recordings.columns.units import scaled
from imuscope.server import wire
from imuscope.server.devices.device.device_demux import LinkDecoder, LinkDevices
from imuscope.server.devices.device.device_state import DeviceState
from imuscope.server.devices.device.ingest import LinkTiming
from imuscope.server.library.collector import MAX_EVENTS, RecordingSink
from imuscope.server.links.base import Chunk
from imuscope.server.streaming.channel_rows import ChannelRows
from imuscope.server.streaming.channels import factors_of
from imuscope.server.streaming.sink import EventSink, SampleArchive, TelemetrySink
from imuscope.server.streaming.telemetry import Telemetry
from tests.support.fakes import FakeClock


class ListSink(EventSink):
    """The least that a sink is: lists."""

    archive: SampleArchive | None = None
    reports_every_gap = True

    def __init__(self, now: Callable[[], float]) -> None:
        self.now = now
        self.infos: dict[int, wire.ChannelInfo] = {}
        self.rows: dict[int, list[ChannelRows]] = {}
        self.events: list[wire.EventInfo] = []
        self.devices: dict[str, wire.DeviceInfo] = {}

    def advertise(self, info: wire.ChannelInfo) -> int:
        number = len(self.infos) + 1
        self.infos[number] = replace(info, id=number)
        return number

    def publish(self, pieces: Iterable[ChannelRows]) -> None:
        for piece in pieces:
            self.rows.setdefault(piece.channel, []).append(piece)

    def add_event(self, event: wire.EventInfo) -> wire.EventInfo:
        event = replace(event, seq=len(self.events))
        self.events.append(event)
        return event

    def set_device(self, info: wire.DeviceInfo) -> None:
        self.devices[info.id] = info

    def remove_device(self, device: str) -> None:
        del self.devices[device]


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[RecordingSink]:
    writer = ColumnStoreWriter(tmp_path / "store")
    sink = RecordingSink(writer, HealthHistoryWriter(writer.temporary))
    yield sink
    sink.close()
    writer.abandon()


def feed(sink: TelemetrySink, clock: FakeClock, chunks: list[bytes], protocol: Decoder | None = None) -> LinkDevices:
    """Decode chunks that arrived 50 ms apart."""
    info = wire.DeviceInfo("1", "simulated", "sim:xbus", "simulator", "live")
    devices = LinkDevices(sink, DeviceState(sink, info, str), str)
    decoder = LinkDecoder(sink, devices, protocol or XbusDecoder(), line=LinkTiming(10e9 / 921_600, "serial"))
    for chunk in chunks:
        clock.move(0.05)
        if isinstance(sink, RecordingSink):
            sink.time = clock()
        decoder.feed(Chunk(chunk, clock.ns))
        decoder.drain()
    decoder.drain(stalled=True)
    for device in devices.all:
        device.events.tick(clock() + 60)
    return devices


def stream() -> list[bytes]:
    """Two seconds of an MTi, one chunk of which is lost and one is damaged."""
    device = XbusSimulator(start_ns=0, measuring=True)
    chunks = [device.advance(n * 50_000_000) for n in range(1, 41)]
    chunks[20] = b""
    chunks[30] = bytes(byte ^ (at == 50) for at, byte in enumerate(chunks[30]))
    return chunks


def test_every_sink_receives_the_same_data(recording: RecordingSink) -> None:
    chunks = stream()
    clocks = [FakeClock(), FakeClock(), FakeClock()]
    lists, telemetry = ListSink(clocks[0]), Telemetry.create(clocks[1])
    sinks: list[TelemetrySink] = [lists, telemetry.bus, recording]
    for sink, clock in zip(sinks, clocks, strict=True):
        feed(sink, clock, chunks)
    described = [(info.name, info.columns) for info in lists.infos.values()]
    assert described == [(channel.info.name, channel.info.columns) for channel in telemetry.store.all]
    sent = [(info.name, info.columns) for info in recording.infos.values() if info.name != "EulerAngles"]
    assert sent == [one for one in described if one[0] != "EulerAngles"]
    for channel in telemetry.store.all:
        pieces = lists.rows[channel.info.id]
        factors = (1, 1, *(factors_of(channel.info) or [1] * len(channel.info.columns)))
        for k, (column, factor) in enumerate(zip(channel.ring.read(), factors, strict=True)):
            sent = np.concatenate([piece.columns[k] for piece in pieces])
            np.testing.assert_array_equal(column, scaled(sent, factor) if factor != 1 else sent)
    messages = [(event.kind, event.text, event.samples) for event in lists.events]
    assert {kind for kind, _, _ in messages} >= {"gap", "reject"}
    assert [(event.kind, event.text, event.samples) for event in recording.events] == messages
    assert lists.devices["1"].name == telemetry.bus.devices.latest["1"].name


def test_clock_readings_go_to_the_archive_alone(recording: RecordingSink) -> None:
    """Details such as a sequence number are not in a live view but in an export."""
    device = IdtpSimulator()
    chunks = [device.advance(n * 50_000_000) for n in range(1, 21)]
    live = Telemetry.create(FakeClock()).bus
    feed(live, FakeClock(), chunks, IdtpDecoder())
    assert live.archive is None
    feed(recording, FakeClock(), chunks, IdtpDecoder())
    assert {column.name for info in recording.clocks.values() for column in info.columns} >= {"sequence"}


def test_a_device_that_leaves_is_forgotten_live_and_kept_in_a_recording(recording: RecordingSink) -> None:
    clock = FakeClock()
    lists = ListSink(clock)
    feed(lists, clock, stream()[:3]).remove()
    assert lists.devices == {}
    feed(recording, FakeClock(), stream()[:3]).remove()
    assert recording.infos


def test_a_recording_limits_events_and_keeps_every_gap(recording: RecordingSink) -> None:
    for _ in range(MAX_EVENTS + 5):
        recording.event("1", "reject", "warning", "x")
    gap = recording.event("1", "gap", "error", "lost", span=(1.0, 2.0), samples=3)
    assert (len(recording.events), recording.left_out) == (MAX_EVENTS + 1, 5)
    assert recording.events[-1] is gap
    assert (gap.t0, gap.t1, gap.samples, gap.time) == (1.0, 2.0, 3, recording.now())
