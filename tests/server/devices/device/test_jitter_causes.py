"""From a simulator's bytes to the times that a page draws, and to why they are uneven: line, adapter and session
are the real ones; the clock is moved by the test.
"""

import asyncio
import itertools
from contextlib import AbstractAsyncContextManager
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imuscope.protocols.clocks.clock_sync import ClockSync
from imuscope.protocols.events import Batch, Event
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server import wire
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.device import jitter_causes
from imuscope.server.devices.device.jitter_causes import cause_of
from imuscope.server.devices.link.session import Session
from imuscope.server.links.base import LinkSettings
from imuscope.server.links.line_timing import BUS_NS, byte_time_ns, holds_ns
from imuscope.server.links.simulated_line import LineFaults, SimulatedLine
from imuscope.server.streaming.telemetry import Telemetry
from tests.protocols.clocks.timing_model import EPOCH_NS, ModelDevice, Way, mapped, stream
from tests.server.devices.session_harness import SessionHarness, started
from tests.support.each_row import each_row
from tests.support.fakes import FakeClock, FakeLink

PPM = 50
PERIOD_NS = 10e6 / (1 + PPM * 1e-6)  # of its samples, on the host's clock
SPREAD_S, MS = 0.2e-3, 1e-3


class TimeHarness(SessionHarness):
    """An MTi-630 at 100 Hz with a clock 50 ppm fast, its line, and a session that decodes ten times a second."""

    def __init__(self, faults: LineFaults) -> None:
        super().__init__(all_protocols(), DecodeOptions(protocol="xbus"))
        self.cable = SimulatedLine(faults, 0, "xbus")
        self.device = self._powered(0)
        self._samples = 0
        self.asleep_until = 0  # until when the host reads nothing, ns

    def _powered(self, start_ns: int) -> XbusSimulator:
        return XbusSimulator(start_ns=start_ns, clock_drift_ppm=PPM, measuring=True)

    def reset(self) -> None:
        """The device starts again, its samples in step with those before."""
        self.device = self._powered(round(self._samples * PERIOD_NS))

    async def run(self, seconds: float) -> None:
        """Sample after sample, each chunk read when the cable has it."""
        for _ in range(round(seconds * 100)):
            self._samples += 1
            now = int(self._samples * PERIOD_NS) + 1
            while (due := self.cable.next_ns) is not None and due <= now:
                await self._read(due)
            self.cable.send(self.device.advance(now), now)
            if self._samples % 10 == 0:
                self.session.access.decode()
                self.session.tick(self.clock())

    async def _read(self, due: int) -> None:
        self.clock.ns = self.began + max(due, self.asleep_until)
        await self.receive(self.cable.arrived(max(due, self.asleep_until)))

    def times(self, since_s: float) -> NDArray[np.float64]:
        """Of the samples of a channel, as a page gets them."""
        time = self.channel("Acceleration").ring.read()[1]
        return np.asarray(time[time > self.began / 1e9 + since_s])

    def off(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Error of each time against the sampling time, s."""
        k = np.round((times - self.began / 1e9) * 1e9 / PERIOD_NS)
        return np.asarray(times - self.began / 1e9 - k * PERIOD_NS / 1e9)


def playing(faults: LineFaults) -> AbstractAsyncContextManager[TimeHarness]:
    return started(TimeHarness(faults))


def check(stage: TimeHarness, since_s: float) -> wire.DeviceHealth:
    """Required accuracy of times after ten seconds."""
    times = stage.times(since_s)
    off = stage.off(times)
    health = stage.health
    assert len(times) > 300
    assert np.ptp(off) <= SPREAD_S
    assert health.uncertainty_ms is not None
    assert np.abs(off).max() <= health.uncertainty_ms * MS
    assert (np.diff(times) > 0).all()
    assert np.abs(np.diff(off)).max() < 0.1 * MS, "no comb"
    return health


async def test_a_line_without_jitter_is_drawn_evenly_without_a_report() -> None:
    async with playing(LineFaults(baud=115200)) as stage:
        await stage.run(15)
        health = check(stage, 10)
        assert health.jitter_cause is None
        assert health.uncertainty_ms is not None
        assert health.uncertainty_ms < 0.5
        assert health.drift_ppm == pytest.approx(PPM, abs=10)


async def test_the_bursts_of_an_adapter_are_drawn_evenly_and_named_with_the_remedy() -> None:
    async with playing(LineFaults(baud=115200, burst_ms=16, drop=0.02)) as stage:
        await stage.run(15)
        cause = check(stage, 10).jitter_cause
        assert cause is not None
        assert cause.kind == "bursts"
        assert "latency timer" in cause.text
        assert "latency_timer" in cause.remedy
        assert "udev" in cause.remedy


async def test_a_device_restart_is_a_reported_break() -> None:
    async with playing(LineFaults(baud=115200)) as stage:
        await stage.run(4)
        stage.reset()
        await stage.run(15)
        cause = check(stage, 14.5).jitter_cause
        assert cause is not None
        assert cause.kind == "resets"
        assert "once" in cause.text
        [step] = [event for event in stage.telemetry.log if event.kind == "clock"]
        assert step.text == "The device's clock started again from zero."
        assert step.time == pytest.approx(stage.began / 1e9 + 4, abs=0.02)
        assert (np.diff(stage.times(0)) > 0).all()


async def test_a_host_that_did_not_read_moves_no_sample_and_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jitter_causes, "LATELY_S", 10.0)

    async with playing(LineFaults(baud=115200)) as stage:
        await stage.run(12)
        stage.asleep_until = 12_300_000_000
        await stage.run(4)
        health = check(stage, 10)
        assert health.lost == 0
        cause = health.jitter_cause
        assert cause is not None
        assert cause.kind == "stalls"
        assert (
            cause.text == "Nothing was read for 0.3 s, then all at once: this host did not run the server in that time."
        )
        await stage.run(11)
        assert stage.health.jitter_cause is None, "after a while it is history"


def test_every_cause_is_a_sentence_with_a_remedy() -> None:
    """Over a network no jitter is attributed to an adapter, and no change is suggested for an adapter at 1 ms."""
    way = Way(0, network_ms=3)
    network = mapped(stream(ModelDevice(((100, 60),)), way, 10), ClockSync(unknown_ns=1e6)).clock
    now = EPOCH_NS / 1e9 + 10
    result = cause_of(network, [], kind="udp", port="", now=now)
    assert result is not None
    assert result.kind == "network"
    late = mapped(stream(ModelDevice(), Way(timer_ms=16), 10), ClockSync(86_806, holds_ns=1e6)).clock
    hub = cause_of(late, [], kind="serial", port="ttyUSB1", now=now)
    assert hub is not None
    assert "latency timer of the USB adapter is 1 ms" in hub.text
    timer = mapped(stream(ModelDevice(), Way(timer_ms=16), 10), ClockSync(86_806, holds_ns=16e6)).clock
    bursts = cause_of(timer, [], kind="serial", port="ttyUSB1", now=now)
    assert bursts is not None
    assert "/sys/bus/usb-serial/devices/ttyUSB1/latency_timer" in bursts.remedy
    often = cause_of(timer, [now - 50, now - 10, now - 90], kind="serial", port="", now=now)
    assert often is not None
    assert "2 times" in often.text
    for cause in (result, hub, bursts, often):
        assert cause.text.endswith(".")
        assert cause.remedy.endswith(".")


def test_the_properties_of_a_port_before_the_first_byte(tmp_path: Any) -> None:
    devices = tmp_path / "bus/usb-serial/devices"
    for name in ("ttyUSB0", "ttyUSB1"):
        (devices / name).mkdir(parents=True)
    (devices / "ttyUSB0/latency_timer").write_text("16\n")
    link: Any = FakeLink("", LinkSettings(now_ns=FakeClock().now_ns, sys_root=tmp_path))
    known = {}
    for name in ("ttyUSB0", "ttyUSB1", "ttyACM0", "ttyS0"):
        link.place = f"/dev/{name}"
        known[name] = (holds_ns(link), round(byte_time_ns(link)))
    assert known == {
        "ttyUSB0": (16e6, 86_806),
        "ttyUSB1": (BUS_NS, 86_806),
        "ttyACM0": (BUS_NS, 0),  # the port is USB itself: its rate means nothing
        "ttyS0": (0, 86_806),
    }


@each_row("protocol", ["xbus", "isb", "idtp"])
def test_the_size_of_a_frame_is_what_it_was_on_the_wire(protocol: str) -> None:
    """Regression: the size was computed from the fields with 3 bytes each, milliseconds too much on a slow line."""
    device: Any = {"xbus": XbusSimulator(measuring=True), "isb": IsbSimulator(), "idtp": IdtpSimulator()}[protocol]
    device.advance(0)
    data = device.advance(2_000_000_000)
    for step in (len(data), 64):
        decoder = PROTOCOLS[protocol].decoding.decoder()
        events: list[Event] = []
        for at in range(0, len(data), step):
            decoder.feed(data[at : at + step], at)
            events += decoder.drain()
        results = [event for event in events if isinstance(event, Batch) and event.size]
        starts = np.sort(np.concatenate([batch.offset for batch in results]))
        sizes = {int(at): batch.size for batch in results for at in batch.offset}
        follows = [at for at, following in itertools.pairwise(starts) if at + sizes[int(at)] == following]
        assert len(follows) > 0.9 * len(starts)
        assert all(at + sizes[int(at)] <= following for at, following in itertools.pairwise(starts))


@each_row("speed", [0.5, 2.0, 20.0])
async def test_a_capture_played_faster_is_not_a_clock_jump(speed: float) -> None:
    """`capture.bin?speed=2`: two seconds of the device's clock pass in one of the host's."""
    clock = FakeClock()
    telemetry = Telemetry.create(clock)
    link: Any = FakeLink("/dev/ttySIM", LinkSettings(now_ns=clock.now_ns))
    link.speed = speed
    session = Session("1", link, telemetry.bus, all_protocols(), DecodeOptions(protocol="idtp"))
    session.start()
    await asyncio.sleep(0.001)
    device, began = IdtpSimulator(), clock.ns
    for k in range(1, 601):
        clock.ns = began + round(k * 1e7 / speed)
        link.send(device.advance(k * 10_000_000))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        if k % 10 == 0:
            session.access.decode()
            session.tick(clock())
    texts = [event.text for event in telemetry.log if event.kind == "clock" or event.data.get("reason") == "unit"]
    channel = next(one for one in telemetry.store.all if one.info.name == "Acceleration")
    steps = np.diff(channel.ring.read()[1][100:])
    await session.close()
    assert texts == []
    assert abs(steps - 0.01 / speed).max() < 0.002 / speed
