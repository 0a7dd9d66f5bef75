"""Simulators: a device that is not there, behind a real pseudo-terminal, with everything that goes wrong with a
cable.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import time
from typing import Any

import pytest

from imuscope.protocols.events import RejectedFrame, SampleGap, batches
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.frames import build
from imuscope.server.links import serial
from imuscope.server.links.base import Link, LinkError
from imuscope.server.links.detection_text import describe_bytes
from imuscope.server.links.serial import SerialLink, SerialSettings, open_port
from imuscope.server.links.simulated_device import SimulatorOptions, make_device
from imuscope.server.links.simulator import SimulatorLink, SimulatorThread
from imuscope.server.links.source_url import SourceUrl, open_link
from tests.server.links.link_fixtures import (
    PeriodicDevice,
    dies,
    fails,
    frame,
    gather,
    joined,
    left_behind,
    opened,
    settings,
    xbus,
)
from tests.support.each_row import each_row
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


def simulator(query: str = "", rate: float = 200.0) -> SimulatorLink:
    options = open_link(f"sim:xbus?{query}")
    assert isinstance(options, SimulatorLink)
    return SimulatorLink(options.source, settings(), options.options, lambda start_ns: PeriodicDevice(start_ns, rate))


async def test_a_simulator_streams_answers_and_cleans_up() -> None:
    before = left_behind()
    link = simulator()
    await link.open()
    assert (link.kind, link.source, link.baud, link.capacity) == ("simulator", "sim:xbus?", 115_200, 11_520)
    data = joined(await gather(link, 400))
    assert data.startswith(frame(0, 0))
    assert describe_bytes(data).certain
    await link.write(b"\xfa\xff\x30\x00\xd1")
    await gather(link, until=lambda data: b"\xff\x3f\x05\xfa\xff\x30\x00\xd1" in data)
    await link.close()
    await link.close()
    assert left_behind() == before


async def bytes_of_next_plug(link: Link) -> bytes:
    """What a device sends first when it is plugged in next; nothing if a busy machine was too late for it."""
    await asyncio.sleep(0.25)
    try:
        await link.open()
        return joined(await gather(link, 100))
    except LinkError as error:
        if error.kind not in ("gone", "not-found"):
            raise
        return b""


async def test_a_simulator_is_unplugged_and_returns() -> None:
    before = left_behind()
    link = simulator("unplug_s=0.2&away_s=0.2")
    await link.open()
    error = await dies(link)
    assert error.kind == "gone"
    await link.close()
    error = await fails(link.open())
    assert error.kind == "not-found"
    assert "unplugged" in error.message
    async with asyncio.timeout(PATIENCE_S):
        while not (first := await bytes_of_next_plug(link)):
            await link.close()
    assert first.startswith(frame(0, 0))
    await link.close()
    assert left_behind() == before


def received(port: Any, size: int) -> bytes:
    """The next `size` bytes of an open port, or some more; it is closed then."""
    data = bytearray()

    def are_there() -> bool:
        data.extend(port.read(4096))
        return len(data) >= size

    block_until(are_there, f"{size} bytes")
    port.close()
    return bytes(data)


def test_a_simulator_whose_reader_is_late_loses_nothing() -> None:
    """Regression: 135 samples were lost at the start: nothing was read during a compilation, and the 4 kB port buffer
    of the simulator overflowed, where a real port holds 640.
    """
    options = simulator("rate=2000").options
    bench = SimulatorThread(lambda start_ns: PeriodicDevice(start_ns, 2000), options)
    port = open_port(bench.slave, SerialSettings(baud=options.faults.baud))
    bench.start()
    bench.release()
    time.sleep(0.6)  # 20 kB
    data = received(port, 30_000)
    bench.stop()
    assert data.startswith(b"".join(frame(n, 5 * n) for n in range(1500)))


async def test_a_simulator_reports_its_backlog() -> None:
    """As with a serial link, a session that cannot keep up must know that more data are waiting."""
    link = simulator()
    await link.open()
    await asyncio.to_thread(block_until, lambda: link.backlog > 100, "bytes wait")
    assert link.read_now(0)
    await link.close()
    assert (link.backlog, link.read_now(0)) == (0, [])


def test_a_delayed_simulator_does_not_fill_its_line() -> None:
    """Its line was taken to be half a second behind, and the samples made up for were dropped."""
    late_ns = 0
    options = simulator("rate=2000&baud=460800").options
    bench = SimulatorThread(
        lambda start_ns: PeriodicDevice(start_ns, 2000), options, lambda: time.monotonic_ns() + late_ns
    )
    port = open_port(bench.slave, SerialSettings(baud=options.faults.baud))
    bench.start()
    bench.release()
    time.sleep(0.05)
    late_ns = 2_000_000_000
    data = received(port, 80_000)
    bench.stop()
    assert data.startswith(b"".join(frame(n, 5 * n) for n in range(4000)))


async def test_the_first_frame_of_a_simulator_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening the port clears it: the wake-up was lost at times, or cut, which was counted as a bad checksum."""

    def slowly(place: str, line: SerialSettings) -> Any:
        time.sleep(0.05)
        return open_port(place, line)

    monkeypatch.setattr(serial, "open_port", slowly)

    link = simulator(rate=2000)
    await link.open()
    assert joined(await gather(link, 60)).startswith(frame(0, 0))
    await link.close()


async def test_bursts_arrive_as_bursts() -> None:
    link = simulator("burst_ms=50&packet=0&baud=921600", rate=400)
    await link.open()
    chunks = await gather(link, 3000)
    await link.close()
    gaps = [b.arrival_ns - a.arrival_ns for a, b in itertools.pairwise(chunks)]
    assert max(gaps) > 40e6
    assert len(chunks) < 40  # 3000 B are some 170 frames


async def test_a_simulator_at_another_rate_is_noise_until_the_port_follows() -> None:
    link = simulator()
    await link.open()
    await gather(link, 100)
    await link.write(xbus(0x18, b"\x00"))
    await gather(link, until=lambda data: len(data) > 400 and not describe_bytes(data[-300:]).recognised)
    await link.close()


def test_a_fault_in_a_simulator_resembles_a_pulled_plug(caplog: pytest.LogCaptureFixture) -> None:
    class Faulty(PeriodicDevice):
        def advance(self, now_ns: int) -> bytes:
            if self.sent > 5:
                raise RuntimeError("broken")
            return super().advance(now_ns)

    async def check() -> None:
        before = left_behind()
        link = SimulatorLink("sim:xbus", settings(), simulator().options, lambda start_ns: Faulty(start_ns))
        await link.open()
        assert (await dies(link)).kind == "gone"
        await link.close()
        assert left_behind() == before

    asyncio.run(check())
    assert "broken" in caplog.text


def test_no_pseudo_terminal_available(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left() -> tuple[int, int]:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "openpty", none_left)
    error = asyncio.run(fails(simulator().open()))
    assert error.kind == "refused"
    assert "/dev/ptmx" in error.hint


def test_the_line_is_fast_enough_for_the_samples() -> None:
    chosen = {rate: simulator(f"rate={rate}").options.faults.baud for rate in (1, 100, 200, 400, 800, 2000)}
    assert chosen == {1: 115_200, 100: 115_200, 200: 230_400, 400: 460_800, 800: 921_600, 2000: 4_000_000}


@each_row("query", ["", "rate=400&product=MTi-680G", "drop=0.05&corrupt=0.05&burst_ms=16&drift_ppm=50&jump_s=1"])
async def test_the_real_simulator_streams(query: str) -> None:
    before = left_behind()
    link = open_link(f"sim:xbus?{query}", settings())
    await link.open()
    chunks = await gather(link, 8000)
    await link.close()
    assert left_behind() == before
    assert describe_bytes(joined(chunks)).recognised
    if not query:
        assert joined(chunks).startswith(xbus(0x3E))  # WakeUp
        decoder = PROTOCOLS["xbus"].decoding.decoder()
        for chunk in chunks:
            decoder.feed(chunk.data, chunk.arrival_ns)
        events = decoder.drain()
        assert not [event for event in events if isinstance(event, RejectedFrame | SampleGap)]
        (batch,) = list(batches(events))[-1:]
        assert "SampleTimeFine" in batch.columns


@each_row(
    ("source", "baud", "names"),
    [
        ("sim:isb", 921_600, {"DID_IMU", "DID_INS_1", "DID_INS_2"}),
        ("sim:isb?rate=400&drift_ppm=50&jump_s=1&burst_ms=16", 921_600, {"DID_IMU", "DID_INS_1"}),
        ("sim:idtp", 230_400, {"Imu10", "ImuQuat"}),
        ("sim:idtp?mode=lite&rate=50", 115_200, {"Imu10", "ImuQuat"}),
        ("sim:idtp?mode=secure", 230_400, {"Imu10", "ImuQuat"}),
    ],
)
async def test_simulators_of_the_other_families_stream(source: str, baud: int, names: set[str]) -> None:
    before = left_behind()
    key = b"0123456789abcdef"
    link = open_link(source, settings(decode_options={"key": key.hex()}))
    await link.open()
    assert (link.baud, link.kind) == (baud, "simulator")
    chunks = await gather(link, 12_000)
    await link.close()
    assert left_behind() == before
    row = PROTOCOLS[source[4:].partition("?")[0]]
    decoder = row.decoding.decoder(**({"key": key} if "secure" in source else {}))
    for chunk in chunks:
        decoder.feed(chunk.data, chunk.arrival_ns)
    events = decoder.drain()
    assert not [event for event in events if isinstance(event, RejectedFrame | SampleGap)]
    assert {batch.message.name for batch in batches(events)} >= names


async def test_a_simulator_with_an_unknown_key() -> None:
    link = open_link("sim:idtp?mode=secure", settings())
    await link.open()
    data = joined(await gather(link, 3000))
    await link.close()
    decoder = PROTOCOLS["idtp"].decoding.decoder(key=b"a guess")
    decoder.feed(data, 0)
    assert {event.reason for event in decoder.drain() if isinstance(event, RejectedFrame)} == {"bad_hmac"}


def test_faults_cut_whole_frames_of_any_family() -> None:
    async def check(protocol: str) -> None:
        link = open_link(f"sim:{protocol}?drop=0.3", settings())
        await link.open()
        data = joined(await gather(link, 8000))
        await link.close()
        decoder = PROTOCOLS[protocol].decoding.decoder()
        decoder.feed(data, 0)
        assert not [event for event in decoder.drain() if isinstance(event, RejectedFrame)]

    for protocol in ("isb", "idtp"):
        asyncio.run(check(protocol))


@each_row("source", ["sim:isb?mode=lite", "sim:idtp?product=MTi-630", "sim:isb?product=MTi-630"])
def test_options_belong_to_their_family(source: str) -> None:
    with pytest.raises(LinkError) as caught:
        open_link(source, settings())
    assert caught.value.kind == "bad-source"


@each_row(("clock", "tick_ns"), [("ns", 1), ("us", 1_000), ("ms", 1_000_000), ("s", 1_000_000_000)])
def test_a_simulator_whose_timestamps_count_in_another_unit(clock: str, tick_ns: int) -> None:
    options = SimulatorOptions.of(SourceUrl.parse(f"sim:idtp?clock={clock}"))
    data = make_device(options, 0, None).advance(2_000_000_000)
    decoder = PROTOCOLS["idtp"].decoding.decoder(time_unit=clock, replay_check=False)
    decoder.feed(data, 0)
    last = max(int(batch.time_ns[-1]) for batch in batches(decoder.drain(stalled=True)) if batch.time_ns is not None)
    assert 2_000_000_000 - max(10_000_000, tick_ns) <= last <= 2_000_000_000
    with pytest.raises(LinkError, match="clock is 'min', not one of us, ns, ms, s"):
        SimulatorOptions.of(SourceUrl.parse("sim:idtp?clock=min"))


async def test_an_idtp_simulator_that_resets_counts_from_zero() -> None:
    """Sequence numbers and timestamps both, for which a Secure device is locked out and a Safety device waits 3 s."""
    link = open_link("sim:idtp?reset_s=0.3", settings())
    async with opened(link):
        heads = lambda data: [i for i in range(len(data) - 20) if data[i : i + 12] == b"IDTP" + bytes(8)]  # noqa: E731
        await gather(link, until=lambda data: len(heads(data)) >= 2)


async def test_a_simulator_that_resets() -> None:
    link = simulator("reset_s=0.2")
    await link.open()
    data = joined(await gather(link, until=lambda data: data.count(frame(0, 0)) >= 2))
    await link.close()
    assert data.count(frame(1, 50)) >= 1


def test_a_serial_link_can_be_made_without_a_source() -> None:
    """Reported path and line, as simulators give them, independent of the name of the source."""
    link = SerialLink("sim:x", settings(), "/dev/ttyX", SerialSettings(baud=9600))
    assert (link.source, link.place) == ("sim:x", "/dev/ttyX")


async def test_a_rate_that_the_cable_cannot_carry() -> None:
    """Device and port change to the new rate, but nothing is readable until both go back."""
    link = open_link("sim:xbus?product=MTi-3&dead_baud=921600", settings())
    async with opened(link):
        await gather(link, 2000)
        for request, answer in ((build(0x30), build(0x31)), (build(0x18, b"\x80") + build(0x40), build(0x41))):
            await link.write(request)
            await gather(link, until=lambda data, answer=answer: answer in data)  # type: ignore[misc]
        await link.reopen(921_600)
        noise = joined(await gather(link, 3000))
        assert b"\xfa\xff\x36" not in noise
        assert not describe_bytes(noise).certain


def cycle(link: SimulatorLink) -> None:
    """Switch the power of the device off and on."""
    assert link._simulator is not None
    link._simulator.cycle()


async def test_a_simulator_keeps_what_it_stored_when_its_power_fails() -> None:
    link = open_link("sim:xbus", settings())
    assert isinstance(link, SimulatorLink)
    async with opened(link):
        await gather(link, 500)
        await link.write(bytes.fromhex("FAFF3000D1FAFF8402123435"))
        await gather(link, until=lambda data: bytes.fromhex("FAFF85007C") in data)
        cycle(link)
        await gather(link, until=lambda data: bytes.fromhex("FAFF3E00C3") in data)
        await link.write(bytes.fromhex("FAFF3F00C2FAFF84007D"))
        await gather(link, until=lambda data: bytes.fromhex("FAFF8502123434") in data)


async def test_restore_bytes_bring_a_lost_device_back() -> None:
    """At 921 600 Bd the device is unreachable; 0xDE during power-up makes it start at 115 200 Bd."""

    async def connect(link: Link) -> None:
        while True:
            await link.write(b"\xde")
            await asyncio.sleep(0.0003)

    async def comes(link: Link, data: bytes) -> bool:
        """Whether these bytes come before long; a busy machine may have been too late for the device."""
        try:
            await asyncio.wait_for(gather(link, until=lambda read: data in read), 2.0)
        except TimeoutError:
            return False
        return True

    async def starts_at_another_rate(link: SimulatorLink) -> bool:
        connecting = asyncio.create_task(connect(link))
        try:
            cycle(link)
            if not await comes(link, build(0x3E)):
                return False
        finally:
            connecting.cancel()
        await link.write(build(0x3F) + build(0x18))  # within half a second of its WakeUp
        return await comes(link, build(0x19, b"\x02"))

    link = open_link("sim:xbus?baud=921600&dead_baud=921600", settings())
    assert isinstance(link, SimulatorLink)
    async with opened(link):
        await link.reopen(115_200)
        while not await starts_at_another_rate(link):
            pass
