"""The compiled reading loop: every read with its own time, whatever is gathered, and the same in plain Python."""

from __future__ import annotations

import fcntl
import os
import struct
import termios
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from imuscope.protocols.native.kernels import plain
from imuscope.recordings.mcap.read_memory import BUFFER_BYTES, MAX_READS, NEVER_NS, READ_LIMIT, ReadFollower
from imuscope.server.links import read_loop
from imuscope.server.links.base import Chunk, steady_clock
from imuscope.server.links.read_loop import ReadLoop, monotonic_offset_ns
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

FAR_NS = 1 << 62
SESSION, RECORDING = 0, 1


class ReadEnd:
    """A loop at the reading end of a pipe, with the clock of its times."""

    def __init__(self) -> None:
        self.now_ns = steady_clock()
        self.fd, self.writer = os.pipe()
        self.stopped, self.stop = os.pipe()
        os.set_blocking(self.fd, False)
        self.deadlines = np.array([NEVER_NS, NEVER_NS], np.int64)
        self.loop = ReadLoop(self.fd, self.stopped, self.now_ns, self.deadlines)

    def read(self, timeout_s: float | None, until_ns: int) -> list[Chunk]:
        """Read in this thread, and take."""
        self.loop.read(timeout_s, until_ns)
        return self.loop.take_last()

    def waiting(self) -> int:
        """Bytes in the pipe."""
        return int(struct.unpack("i", fcntl.ioctl(self.fd, termios.FIONREAD, bytes(4)))[0])

    def write(self, data: bytes) -> tuple[int, int]:
        """Write, and wait until it is read; the times before and after."""
        before = self.now_ns()
        os.write(self.writer, data)
        block_until(lambda: not self.waiting(), "it is read")
        return before, self.now_ns()

    def close(self) -> None:
        for fd in (self.fd, self.writer, self.stopped, self.stop):
            if fd >= 0:
                os.close(fd)


@pytest.fixture(params=["compiled", "plain"])
def end(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[ReadEnd]:
    if request.param == "plain":
        for name in ("gather", "promise"):
            monkeypatch.setattr(read_loop, name, plain(getattr(read_loop, name)))
    made = ReadEnd()
    yield made
    made.close()


def test_gathered_reads_have_their_own_times(end: ReadEnd) -> None:
    results: list[Chunk] = []
    reader = threading.Thread(target=lambda: results.extend(end.read(None, FAR_NS)))
    reader.start()
    pieces = [bytes([number]) * (number + 1) for number in range(5)]
    spans = [end.write(piece) for piece in pieces]
    os.write(end.stop, b"\0")
    reader.join(PATIENCE_S)
    assert [chunk.data for chunk in results] == pieces
    # A piece is written when the one before has been read, and so when the one before that has got its time.
    latest = [before for before, _ in spans[2:]] + 2 * [end.now_ns()]
    for chunk, (before, _), by in zip(results, spans, latest, strict=True):
        assert before <= chunk.arrival_ns <= by
    assert not end.loop.failed


def test_nothing_is_gathered_once_the_time_is_over(end: ReadEnd) -> None:
    end.deadlines[:] = 0
    os.write(end.writer, b"one")
    (chunk,) = end.read(None, 0)
    assert chunk.data == b"one"
    os.write(end.writer, b"two")
    began = time.monotonic_ns()
    (chunk,) = end.read(None, began + 20_000_000)
    assert chunk.data == b"two"
    assert time.monotonic_ns() - began >= 20_000_000, "it waited for more"


def test_the_wait_for_the_first_byte_ends(end: ReadEnd) -> None:
    began = time.monotonic()
    assert end.read(0.02, FAR_NS) == []
    assert time.monotonic() - began >= 0.02
    assert not end.loop.failed


def test_a_stop_ends_a_wait_without_limit(end: ReadEnd) -> None:
    os.write(end.writer, b"waits for the next owner")
    os.write(end.stop, b"\0")
    assert end.read(None, FAR_NS) == []
    assert end.waiting()


def test_a_failed_read_is_reported_after_the_bytes_before_it(end: ReadEnd) -> None:
    os.write(end.writer, b"last words")
    os.close(end.writer)
    end.writer = -1
    assert [chunk.data for chunk in end.read(None, FAR_NS)] == [b"last words"]
    assert end.loop.failed
    assert end.read(None, FAR_NS) == []
    assert end.loop.failed


def test_more_than_the_memory_holds_is_read_in_several_calls(end: ReadEnd) -> None:
    end.deadlines[:] = 0
    fcntl.fcntl(end.fd, fcntl.F_SETPIPE_SZ, 4 * BUFFER_BYTES)
    data = bytes(range(256)) * (3 * BUFFER_BYTES // 256)
    os.write(end.writer, data)
    received = b""
    while len(received) < len(data):
        chunks = end.read(1, 0)
        assert 0 < len(chunks) <= MAX_READS
        received += b"".join(chunk.data for chunk in chunks)
    assert received == data


class Reading:
    """A loop that reads in a thread of its own, once."""

    def __init__(self, end: ReadEnd) -> None:
        self.end = end
        self.thread = threading.Thread(target=lambda: end.loop.read(None, 0))
        self.thread.start()

    def write(self, data: bytes) -> None:
        """Write, and wait until it is published."""
        count = int(self.end.loop._memory.state[0])
        os.write(self.end.writer, data)
        block_until(lambda: self.end.loop._memory.state[0] > count, "it is read")

    def has_ended(self) -> bool:
        self.thread.join(PATIENCE_S)
        return not self.thread.is_alive()


def test_what_was_read_is_taken_while_the_loop_goes_on(end: ReadEnd) -> None:
    reading = Reading(end)
    reading.write(b"one")
    reading.write(b"two")
    assert [chunk.data for chunk in end.loop.take_for(SESSION, FAR_NS)] == [b"one", b"two"]
    reading.write(b"three")
    assert [chunk.data for chunk in end.loop.take()] == [b"three"]
    assert end.loop.take() == []
    assert reading.thread.is_alive(), "all takers keep their promise"
    os.write(end.stop, b"\0")
    assert reading.has_ended()


@pytest.mark.parametrize("taker", [SESSION, RECORDING])
def test_a_taker_who_found_nothing_is_woken_by_the_next_bytes(end: ReadEnd, taker: int) -> None:
    reading = Reading(end)
    assert end.loop.take_for(taker, FAR_NS) == []
    assert end.deadlines[taker] == 0
    os.write(end.writer, b"wake up")
    assert reading.has_ended()
    assert [chunk.data for chunk in end.loop.take_last()] == [b"wake up"]


def test_a_late_taker_ends_the_loop_with_the_next_bytes(end: ReadEnd) -> None:
    reading = Reading(end)
    reading.write(b"early")
    assert end.loop.take_for(SESSION, 1) != []
    os.write(end.writer, b"late")
    assert reading.has_ended()
    assert [chunk.data for chunk in end.loop.take_last()] == [b"late"], "and what was taken is not taken again"


def test_nothing_is_lost_or_doubled_while_two_threads_take(end: ReadEnd) -> None:
    """One reads, one takes as a session that finds nothing now and then; a lost wake-up would never end."""
    pieces = [bytes([n & 255, n >> 8]) for n in range(3000)]
    results: list[bytes] = []
    lock = threading.Lock()
    woken = threading.Event()

    def collect() -> int:
        with lock:
            chunks = end.loop.take_for(SESSION, FAR_NS)
            results.append(b"".join(chunk.data for chunk in chunks))
        return len(chunks)

    def read() -> None:
        while sum(map(len, results)) < 2 * len(pieces):
            end.loop.read(0.5, 0)
            with lock:
                results.append(b"".join(chunk.data for chunk in end.loop.take_last()))
            woken.set()

    def take() -> None:
        while sum(map(len, results)) < 2 * len(pieces):
            if not collect():
                assert woken.wait(PATIENCE_S)
                woken.clear()

    threads = [threading.Thread(target=one) for one in (read, take)]
    for thread in threads:
        thread.start()
    for piece in pieces:
        os.write(end.writer, piece)
    for thread in threads:
        thread.join(PATIENCE_S)
    assert b"".join(results) == b"".join(pieces)


def test_the_offset_of_a_clock_is_that_of_the_quickest_comparison() -> None:
    slow = iter([True, False, True, True, True])

    def now_ns() -> int:
        now = time.monotonic_ns() + 1_000_000_000_000
        if next(slow):
            time.sleep(0.002)
        return now

    assert abs(monotonic_offset_ns(now_ns) - 1_000_000_000_000) < 1_000_000


def read_of(follower: ReadFollower) -> bytes:
    """All that it can take now."""
    data = b""
    while True:
        follower.advance()
        memory = follower.memories[0]
        count = int(min(memory.state))
        begin = int(memory.ends[follower.take_count - 1]) if follower.take_count else 0
        if count > follower.take_count:
            data += bytes(memory.view[begin : int(memory.ends[count - 1])])
            follower.take_count = count
        if memory.state[READ_LIMIT] != count or len(follower.memories) == 1:
            return data


def test_a_follower_has_every_read_that_the_session_has_from_then_on(end: ReadEnd) -> None:
    """In memory after memory, while the session takes at its own pace."""
    end.deadlines[SESSION] = 0
    fcntl.fcntl(end.fd, fcntl.F_SETPIPE_SZ, 4 * BUFFER_BYTES)
    os.write(end.writer, b"before")
    assert end.read(1, 0) != []
    follower = end.loop.follow()
    data = bytes(range(256)) * (3 * BUFFER_BYTES // 256)
    os.write(end.writer, data)
    session = b""
    while len(session) < len(data):
        session += b"".join(chunk.data for chunk in end.read(1, 0))
    assert len(follower.memories) > 3
    assert read_of(follower) == session == data
    assert len(follower.memories) == 1, "the others are not needed any longer"
    os.write(end.writer, b"last")
    end.read(1, 0)
    end.loop.unfollow()
    os.write(end.writer, b"after")
    end.read(1, 0)
    assert read_of(follower) == b"last"
    assert follower.has_ended


def test_a_follower_that_has_nothing_is_woken_by_the_next_bytes(end: ReadEnd) -> None:
    follower = end.loop.follow()
    woken: list[bytes] = []
    follower.wake = lambda: woken.append(read_of(follower))
    reading = Reading(end)
    assert follower.sleep()
    os.write(end.writer, b"wake up")
    assert reading.has_ended()
    end.loop.take_last()
    end.loop.wake_follower()
    end.loop.wake_follower()
    assert woken == [b"wake up"]
    reading = Reading(end)
    reading.write(b"more")
    assert not follower.sleep(), "there is something"
    reading.write(b"and more")
    assert reading.thread.is_alive(), "it is not to be woken"
    os.write(end.stop, b"\0")
    assert reading.has_ended()


def test_a_follower_that_ends_while_it_waits_is_woken(end: ReadEnd) -> None:
    follower = end.loop.follow()
    woken: list[bool] = []
    follower.wake = lambda: woken.append(follower.has_ended)
    assert follower.sleep()
    end.loop.unfollow()
    assert woken == [True]
    assert end.deadlines[RECORDING] == NEVER_NS
