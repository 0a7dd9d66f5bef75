"""Decode scheduling: at the interval of the most demanding viewer, and at once for answers."""

from __future__ import annotations

import asyncio

from imuscope.server.concurrency.heartbeat import UNWATCHED_S
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.decode_scheduler import DecodeScheduler
from imuscope.server.devices.link.connection_state import ConnectionEvent
from imuscope.server.devices.link.session import Session
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.links.base import Chunk, Link, LinkSettings
from imuscope.server.streaming.clients import FLUSH_S
from imuscope.server.streaming.send_queue import SendQueue
from imuscope.server.streaming.telemetry import Telemetry
from tests.support import virtual_time
from tests.support.each_row import each_row
from tests.support.fakes import SPEECH, FakeClock, FakeLink, sample


class ReadyLink(FakeLink):
    """A link whose bytes are available without waiting, as with a real link."""

    again_ns = 0

    def read_now(self, again_ns: int) -> list[Chunk]:
        self.again_ns = again_ns
        results = []
        while not self._queue.empty():
            chunk = self._queue.get_nowait()
            assert isinstance(chunk, Chunk)
            results.append(chunk)
        return results


def drains(clients: int, interval_s: float = 0.0, devices: int = 2) -> list[int]:
    """Number of drains of each device's decoder in a second in which it sends 250 samples."""

    async def run() -> list[int]:
        clock = FakeClock()
        telemetry = Telemetry.create(clock)
        links: list[ReadyLink] = []

        def open_link(source: str, settings: LinkSettings) -> Link:
            links.append(ReadyLink(source, settings))
            return links[-1]

        sessions = Sessions(
            telemetry.bus,
            open_link,
            SPEECH,
            LinkSettings(now_ns=clock.now_ns),
            wall_ns=clock.now_ns,
            sample_interval=lambda: telemetry.clients.sample_interval,
        )
        for _ in range(clients):
            queue = SendQueue()
            queue.interval_s = interval_s
            telemetry.clients.attach(queue)
        made = [sessions.add(f"/dev/ttyFAKE{number}", DecodeOptions("fake")) for number in range(devices)]
        await asyncio.sleep(0.5)
        counts = [0] * devices
        for number, session in enumerate(made):
            count_drains(session, counts, number)
            session._pipeline.slices._clock = lambda: 0.0  # nor does decoding take any time
        sessions._scheduler._turns._clock = lambda: 0.0
        for k in range(250):
            clock.move(0.004)
            for link in links:
                link.send(sample(k))
            await asyncio.sleep(0.004)
        results = list(counts)
        assert [session.health(clock()).bytes for session in made] == [1000] * devices
        await sessions.close()
        return results

    return virtual_time.run(run())


def count_drains(session: Session, counts: list[int], number: int) -> None:
    decoder = session._pipeline.decoder
    drain = decoder.drain  # type: ignore[attr-defined]

    def counted(**more: bool) -> object:
        counts[number] += 1
        return drain(**more)

    decoder.drain = counted  # type: ignore[attr-defined]


def test_the_number_of_viewers_does_not_affect_decoding() -> None:
    one = drains(1)
    assert one == drains(4) == drains(50)
    assert one[0] == one[1] <= 1 / FLUSH_S + 1
    assert one[0] >= 0.85 / FLUSH_S, "and no sample waits longer than that"


def test_without_viewers_it_decodes_in_long_stretches() -> None:
    assert max(drains(0)) <= 1 / UNWATCHED_S + 1


def test_pages_that_draw_sixty_times_a_second_have_it_decoded_as_often() -> None:
    assert drains(1, 1 / 60) == drains(7, 1 / 60)
    assert 50 <= drains(1, 1 / 60)[0] <= 61


class SilentLink(ReadyLink):
    """A link that never wakes the loop."""

    async def read(self) -> list[Chunk]:
        await asyncio.Event().wait()
        raise AssertionError


def test_while_bytes_arrive_a_session_polls_for_them_by_itself() -> None:
    async def run() -> None:
        clock = FakeClock()
        link = SilentLink("/dev/ttyFAKE", LinkSettings(now_ns=clock.now_ns))
        scheduler = DecodeScheduler(lambda: FLUSH_S)
        session = Session("1", link, Telemetry.create(clock).bus, SPEECH, DecodeOptions("fake"), scheduler=scheduler)
        session.start()
        await asyncio.sleep(0.1)
        link.send(sample(0))
        scheduler.request()  # as the first bytes do
        for k in range(1, 50):
            await asyncio.sleep(FLUSH_S / 2)
            assert link.again_ns == round(FLUSH_S * 1e9)
            link.send(sample(k))
        await asyncio.sleep(2 * FLUSH_S)
        assert session._pipeline.samples == 50
        assert scheduler._timer is None, "without bytes it does not look"
        await session.close()

    virtual_time.run(run())


class BusyLink(ReadyLink):
    """A link of which bytes wait."""

    waiting: int | None = None

    @property
    def waiting_since_ns(self) -> int | None:
        return self.waiting


def test_how_far_decoding_is_behind_is_reported() -> None:
    """A server that was two minutes behind was "live", with empty plots and not a word."""

    async def run() -> None:
        clock = FakeClock()
        link = BusyLink("/dev/ttyFAKE", LinkSettings(now_ns=clock.now_ns))
        session = Session("1", link, Telemetry.create(clock).bus, SPEECH, DecodeOptions("fake"))
        session._connection.apply(ConnectionEvent.START)
        session._connection.apply(ConnectionEvent.OPENED)
        assert session.health(clock()).behind.decoding == 0.0, "nothing waits"
        link.waiting = clock.now_ns()
        clock.move(12)
        assert session.health(clock()).behind.decoding == 12.0
        await session.close()

    virtual_time.run(run())


def test_an_answer_is_decoded_at_once() -> None:
    async def run() -> None:
        clock = FakeClock()
        link = FakeLink("/dev/ttyFAKE", LinkSettings(now_ns=clock.now_ns))
        session = Session("1", link, Telemetry.create(clock).bus, SPEECH, DecodeOptions("fake"))
        session.start()
        await asyncio.sleep(1.0)
        received: list[float] = []
        loop = asyncio.get_running_loop()
        session.listeners.listen(lambda event: received.append(loop.time()))
        for suppressed in (False, True):
            session.access.suppress_timeout(suppressed)
            await asyncio.sleep(UNWATCHED_S)
            link.send(sample(1))  # the first slices of a stretch
            await asyncio.sleep(0.01)
            began = loop.time()
            received.clear()
            link.send(sample(2))
            await asyncio.sleep(1.0)
            (at,) = received
            assert (at == began) is suppressed, "at once, and only then"
        await session.close()

    virtual_time.run(run())


@each_row("busy", [1, 3])
def test_a_decoder_with_remaining_work_yields_to_the_loop(busy: int) -> None:
    async def run() -> None:
        scheduler = DecodeScheduler(lambda: 0.008)
        left = [5] * busy
        passes = 0

        def drain_of(number: int) -> bool:
            left[number] -= 1
            return left[number] > 0

        for number in range(busy):
            scheduler.add(lambda number=number: drain_of(number))
        scheduler.request()
        while any(one > 0 for one in left):
            await asyncio.sleep(0)
            passes += 1
        assert left == [0] * busy

    virtual_time.run(run())


def test_a_backlog_is_decoded_without_waiting_for_the_interval() -> None:
    """A turn that left work is followed by the next one after a rest as long as the turn, not after UNWATCHED_S."""

    async def run() -> float:
        scheduler = DecodeScheduler()
        spent = 0.0
        left = 100

        def clock() -> float:
            return spent

        def drain() -> bool:
            nonlocal spent, left
            spent += 0.02  # more than a turn has
            left -= 1
            return left > 0

        scheduler._turns._clock = clock
        scheduler.add(drain)
        loop = asyncio.get_running_loop()
        began = loop.time()
        scheduler.request()
        while left:
            await asyncio.sleep(0.001)
        return loop.time() - began

    assert 99 * 0.02 <= virtual_time.run(run()) < 99 * 0.03 < 99 * UNWATCHED_S
