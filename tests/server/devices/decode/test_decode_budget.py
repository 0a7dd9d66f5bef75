"""A flood on one link: short turns, turns for the others, and reported drops."""

from __future__ import annotations

import asyncio
import random
import socket
from pathlib import Path
from typing import cast

import pytest

from imuscope.protocols.embedded.nmea import sentence
from imuscope.server.devices.decode import decode_budget
from imuscope.server.devices.decode.decode_budget import INITIAL_BYTES, MIN_BYTES, SLICE_S, TURN_S, RoundRobin, Slices
from imuscope.server.devices.device.event_reporter import TEXT_SORTS
from imuscope.server.devices.device.link_stats import MAX_MESSAGES
from imuscope.server.diagnostics.metrics import Metrics, Sources
from imuscope.server.links.base import CHUNK_COST, Chunk, LinkSettings
from imuscope.server.links.reader_thread import ANSWER_NS, WAKE_NS, ChunkQueue
from imuscope.server.links.source_url import open_link
from imuscope.server.links.tcp import TcpLink
from imuscope.server.links.udp import UdpLink
from imuscope.server.wire import RecorderState
from tests.fault_injection.fault_harness import stage
from tests.support.each_row import each_row
from tests.support.manual_clock import ManualClock
from tests.support.waiting import until


@each_row("byte_s", [1e-9, 1e-7, 1e-6])
async def test_slices_become_as_large_as_fits_their_time(byte_s: float) -> None:
    clock = ManualClock(0.0)
    made = Slices(clock)
    for _ in range(40):
        made.add(made.size)
        assert made.is_full
        made.begin()
        clock.now += made.size * byte_s
        made.end()
    assert made.size == decode_budget.MAX_BYTES or SLICE_S / 2 <= made.size * byte_s <= SLICE_S


async def test_costly_bytes_make_the_next_slice_small_at_once() -> None:
    clock = ManualClock(0.0)
    made = Slices(clock)
    made.add(INITIAL_BYTES)
    made.begin()
    clock.now += 0.1
    made.end()
    assert made.size == MIN_BYTES


@each_row("full", [0.5, 1.0], ids=["half of them full", "all full"])
@each_row("constant", [0.0028, 0.02])
async def test_fixed_costs_do_not_make_slices_small(constant: float, full: float) -> None:
    """Regression: with three senders on one UDP port of a slow machine, each slice cost 3 ms regardless of its size;
    slices became 1 kB, and the server fell behind a stream of 36 kB/s. Afterwards all slices were equally full, so the
    cost per byte could not be learned.
    """
    clock, chance = ManualClock(0.0), random.Random(3)
    made = Slices(clock)
    for _ in range(200):
        size = made.size if chance.random() < full else chance.randrange(300, made.size)
        made.add(size)
        made.begin()
        clock.now += (constant + size * 1e-7) * chance.uniform(0.9, 1.2)
        made.end()
    assert made.size * 1e-7 > constant / 4, "most of the time goes into bytes"
    made.add(made.size)
    made.begin()
    clock.now += 100 * (constant + made.size * 1e-7)
    made.end()
    assert made.size == MIN_BYTES, "a flood begins"


def test_a_permanently_busy_source_starves_no_other() -> None:
    """A turn ends when its time is over, and the next starts with a participant that had none."""
    clock, had = ManualClock(0.0), [0, 0, 0]
    turns = RoundRobin(clock)

    def work(number: int, more: bool) -> bool:
        clock.now += TURN_S * 0.6
        had[number] += 1
        return more

    for number, more in enumerate((True, True, False)):
        turns.add(lambda number=number, more=more: work(number, more))  # type: ignore[misc]
    for _ in range(30):
        before = clock.now
        turns.run()
        assert clock.now - before <= 2 * 0.6 * TURN_S + 1e-9
        assert turns.has_more
    assert min(had) >= 15


def put(inbox: ChunkQueue, count: int, size: int) -> None:
    for number in range(count):
        inbox.put(Chunk(bytes([number % 256]) * size, number))


async def test_the_queue_is_bounded_and_drops_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: 64 MB were queued and decoded in one turn of the event loop. A recording gets the bytes before any
    are dropped.
    """
    monkeypatch.setattr("imuscope.server.links.reader_thread.MAX_HELD", 10_000)

    link = cast(UdpLink, open_link("udp://127.0.0.1:0", LinkSettings(lambda: 0)))
    received: list[Chunk] = []
    link.flow.arrivals.add(received.extend)
    inbox = ChunkQueue(link)
    put(inbox, 100, 1000)
    assert inbox.backlog <= 10_000
    assert inbox.waiting_since_ns == received[-len(inbox._chunks)].arrival_ns
    link.flow.at_once = 1 << 20
    stored = inbox.take_now(0)
    assert len(received) == 100
    assert stored == received[-len(stored) :], "the oldest go"
    assert link.flow.dropped == sum(len(chunk.data) for chunk in received) - sum(len(chunk.data) for chunk in stored)
    assert inbox.backlog == 0
    assert inbox.waiting_since_ns is None


async def test_a_reader_that_polls_by_itself_is_not_woken() -> None:
    link = cast(UdpLink, open_link("udp://127.0.0.1:0", LinkSettings(lambda: 0)))
    inbox = ChunkQueue(link)
    put(inbox, 1, 10)
    assert inbox.flush() is None, "the first chunk wakes it"
    assert await inbox.take()
    waits = []
    for again_ns in (0, 500_000_000):
        put(inbox, 1, 10)
        assert inbox.take_now(again_ns)
        put(inbox, 1, 10)
        waits.append(inbox.flush() or 0)
    assert waits[0] <= WAKE_NS / 1e9 < 0.4 < waits[1]
    assert inbox.gather_until_ns() > 0
    inbox.expect_reply()
    assert (inbox.flush() or 0) <= ANSWER_NS / 1e9
    assert inbox.gather_until_ns() == 0, "an answer must not wait for other bytes"


async def test_one_read_returns_a_bounded_piece() -> None:
    tcp = cast(TcpLink, open_link("tcp://127.0.0.1:1", LinkSettings(lambda: 0)))
    tcp.flow.at_once = 5000
    inbox = ChunkQueue(tcp)
    put(inbox, 3, 8000)
    results = []
    while chunks := inbox.take_now(0):
        assert sum(len(chunk.data) for chunk in chunks) <= 5000
        results += chunks
    assert b"".join(chunk.data for chunk in results) == b"".join(bytes([n]) * 8000 for n in range(3))
    assert inbox.backlog == 0

    udp = cast(UdpLink, open_link("udp://127.0.0.1:0", LinkSettings(lambda: 0)))
    udp.flow.at_once = 1000
    inbox = ChunkQueue(udp)
    put(inbox, 2, 8000)
    assert [len(chunk.data) for chunk in inbox.take_now(0)] == [8000], "a datagram is never cut"


async def test_the_first_slice_is_a_small_one() -> None:
    """The first read gave 64 kB, whatever they were: of `FA` that took two seconds of the event loop."""
    async with stage("udp://127.0.0.1:0?protocol=xbus") as there:
        await until(lambda: there.info.is_open, "the port is open")
        link = cast(UdpLink, there.session._link)
        assert link.flow.at_once == INITIAL_BYTES


@each_row(("protocol", "whole"), [("xbus", False), ("isb", False), ("idtp", True), ("", True)])
async def test_a_datagram_is_cut_where_nothing_is_framed_by_its_end(protocol: str, whole: bool) -> None:
    """A hostile one of 64 kB took up to 0.4 s at once."""
    async with stage(f"udp://127.0.0.1:0?protocol={protocol}" if protocol else "udp://127.0.0.1:0") as there:
        await until(lambda: there.info.is_open, "the port is open")
        link = cast(UdpLink, there.session._link)
        inbox = link._queue
        assert inbox is not None
        link.flow.at_once = 4000
        with inbox._lock:
            inbox._chunks.append(Chunk(bytes(60_000), 7))
            inbox._size += 60_000 + CHUNK_COST
            batch = inbox._take_some()
        assert [len(chunk.data) for chunk in batch] == ([60_000] if whole else [4000])
        inbox._chunks.clear()


async def test_a_connection_is_held_back_unless_it_is_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imuscope.server.links.reader_thread.MAX_HELD", 10_000)

    link = cast(TcpLink, open_link("tcp://127.0.0.1:1", LinkSettings(lambda: 0)))
    inbox = ChunkQueue(link)
    put(inbox, 20, 1000)
    views = iter([False, False, True])
    inbox.wait(10_000, lambda seconds: next(views))
    assert next(views, None) is None, "it waited until the link was closed"
    assert link.flow.dropped == 0
    assert inbox.backlog == 20 * (1000 + CHUNK_COST)
    off = link.flow.arrivals.add(lambda chunk: None)
    put(inbox, 1, 1000)
    assert link.flow.dropped > 0
    inbox.wait(0, lambda seconds: pytest.fail("nobody waits for who only looks"))
    off()


async def test_a_flood_is_reported_and_turns_stay_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """20 MB of sentence heads by UDP froze the server for good; here 2 MB, of which most cannot wait."""
    monkeypatch.setattr("imuscope.server.links.reader_thread.MAX_HELD", 300_000)

    async with stage("udp://127.0.0.1:0?protocol=xbus") as made:
        link = cast(UdpLink, made.session._link)
        await until(lambda: link._socket is not None, "it is open")
        turns = made.sessions._scheduler._turns
        longest = 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in range(1500):
                sender.sendto(b"$GPGGA," * 190, link.address)
                await asyncio.sleep(0)
                longest = max(longest, made.session._pipeline.slices.size)
        await until(lambda: made.info.notices[-1].startswith("Bytes arrive faster"), "a notice says so")
        await until(lambda: not turns.has_more and not link.backlog, "the rest is decoded")
        messages = [event for event in made.events("link") if event.data.get("kind") == "left-out"]
        assert messages
        assert "A recording has them all" in messages[0].text
        figures = made.session._stats
        assert figures.left_out == link.flow.dropped > 0
        assert figures.left_out + figures.bytes.total == len(made.bytes), "what came is decoded or counted"
        assert longest < 64 * 1024, "a slice that costs so much is small"


async def test_random_message_names_do_not_fill_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each distinct sentence was a meter, a channel with its ring, and a line of the log, for ever."""
    monkeypatch.setattr("imuscope.server.streaming.channels.MAX_CHANNELS", 3)
    letters = "ABCDEFGHIJKLM"
    names = [f"P{a}{b}{c}" for a in letters for b in letters for c in letters][:1000]

    async with stage("udp://127.0.0.1:0?protocol=isb") as there:
        intake = there.session.devices.own
        await until(lambda: there.info.is_open, "the port is open")
        for at in range(0, len(names), 100):
            lines = b"".join(sentence(f"{name},1,2") for name in names[at : at + 100])
            there.session._on_chunks([Chunk(lines, there.session._link.settings.now_ns())])
            there.session.access.decode()
            there.session.tick(there.telemetry.bus.now())
        assert len(there.telemetry.store.all) == 3
        assert len(intake.stats.messages) == MAX_MESSAGES + 1
        assert sum(meter.total for meter in intake.stats.messages.values()) == len(names)
        assert len(there.events("text")) == TEXT_SORTS + 1
        assert sum("quantities" in event.text for event in there.events("device")) == 1


async def test_dropped_bytes_are_reported_to_a_monitor() -> None:
    async with stage("udp://127.0.0.1:0?protocol=xbus") as there:
        there.session._link.flow.dropped = 4711
        bus, clients = there.telemetry.bus, there.telemetry.clients.statistics
        sources = Sources(bus, clients, [there.session], RecorderState(False), [], Path("/nowhere"))
        assert 'imuscope_link_left_out_bytes_total{device="1"} 4711' in Metrics(there.telemetry.bus).text(sources)
