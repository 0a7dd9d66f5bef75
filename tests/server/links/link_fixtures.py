"""Fixtures of the link tests. frames, a small device, a pseudo-terminal pulled by hand, a count of what is left
behind.
"""

import asyncio
import contextlib
import gc
import os
import struct
import subprocess
import sys
import threading
import tty
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import TypeVar

import pytest

from imuscope.server.links.base import Chunk, Link, LinkError, LinkSettings, steady_clock
from imuscope.server.links.simulated_device import SimulatorOptions
from imuscope.server.links.simulated_line import LineFaults
from imuscope.server.links.simulator import SimulatorThread
from tests.support.server_process import tied
from tests.support.timeouts import PATIENCE_S

T = TypeVar("T")


def settings(**changes: object) -> LinkSettings:
    return LinkSettings(now_ns=steady_clock(), **changes)  # type: ignore[arg-type]


def frame(counter: int, time_ticks: int, extra: bytes = b"") -> bytes:
    """An MTData2 frame: PacketCounter, SampleTimeFine (0.1 ms), and `extra` items."""
    items = struct.pack(">HBH", 0x1020, 2, counter & 0xFFFF) + struct.pack(">HBI", 0x1060, 4, time_ticks & 0xFFFFFFFF)
    return xbus(0x36, items + extra)


def xbus(message: int, payload: bytes = b"") -> bytes:
    """A standard Xbus frame."""
    body = bytes([0xFF, message, len(payload)]) + payload
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


class PeriodicDevice:
    """The simplest device: a frame at each multiple of its period; answers anything with the bytes it got, framed."""

    next_ns = 0

    def __init__(self, start_ns: int = 0, rate: float = 100.0, extra: bytes = b"") -> None:
        self.period_ns = round(1e9 / rate)
        self.sent = 0
        self.start_ns = start_ns
        self.extra = extra
        self.received = b""
        self.baud = 115_200

    def advance(self, now_ns: int) -> bytes:
        out = b""
        while self.start_ns + self.sent * self.period_ns <= now_ns:
            out += frame(self.sent, self.sent * self.period_ns // 100_000, self.extra)
            self.sent += 1
        return out

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self.received += data
        if data.startswith(xbus(0x18)[:3]) and len(data) == 6:  # SetBaudrate, which acts at once here
            self.baud = {0x00: 460_800, 0x02: 115_200}[data[4]]
        return xbus(0x3F, data)


async def gather(link: Link, size: int = 0, *, until: Callable[[bytes], bool] | None = None) -> list[Chunk]:
    """Read until `size` bytes (or `until` is content) have come."""
    chunks: list[Chunk] = []
    async with asyncio.timeout(PATIENCE_S):
        while True:
            chunks += await link.read()
            data = joined(chunks)
            if until(data) if until else len(data) >= size:
                return chunks


def joined(chunks: list[Chunk]) -> bytes:
    return b"".join(chunk.data for chunk in chunks)


async def fails(awaitable: Awaitable[T]) -> LinkError:
    """The LinkError with which it ends; every one has words and a hint."""
    with pytest.raises(LinkError) as caught:
        async with asyncio.timeout(PATIENCE_S):
            await awaitable
    error = caught.value
    assert error.message.endswith((".", "?")), error.message
    assert error.hint, error.message
    return error


async def dies(link: Link) -> LinkError:
    """Read until the link is dead."""

    async def drain() -> None:
        while True:
            await link.read()

    return await fails(drain())


@contextlib.asynccontextmanager
async def opened(link: Link) -> AsyncIterator[Link]:
    await link.open()
    try:
        yield link
    finally:
        await link.close()


class Pty:
    """A pseudo-terminal whose master is controlled by the test."""

    def __init__(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        self._slave = slave

    def write(self, data: bytes) -> None:
        os.write(self.master, data)

    def let_go(self) -> None:
        """The link has the slave open: only it may keep the port alive."""
        if self._slave >= 0:
            os.close(self._slave)
            self._slave = -1

    def pull(self) -> None:
        """Unplug."""
        self.let_go()
        if self.master >= 0:
            os.close(self.master)
            self.master = -1


@contextlib.contextmanager
def pty() -> Iterator[Pty]:
    port = Pty()
    try:
        yield port
    finally:
        port.pull()


@contextlib.contextmanager
def device(baud: int, rate: float = 200.0) -> Iterator[SimulatorThread]:
    """A device behind a pseudo-terminal that communicates at `baud`."""
    options = SimulatorOptions("xbus", faults=LineFaults(baud=baud))
    bench = SimulatorThread(lambda start_ns: PeriodicDevice(start_ns, rate), options)
    bench.start()
    try:
        yield bench
    finally:
        bench.stop()


def left_behind() -> tuple[int, list[str]]:
    """Open file descriptors and our threads (the event loop's own helper threads not counted)."""
    gc.collect()  # what an earlier test in this process left open is closed now, not between two counts
    names = [thread.name for thread in threading.enumerate() if thread.name.startswith(("link ", "simulator "))]
    return len(list(Path("/proc/self/fd").iterdir())), names


HAVING = """
import fcntl, os, sys
port = os.open(sys.argv[1], getattr(os, sys.argv[2]) | os.O_NOCTTY)
if "lock" in sys.argv:
    fcntl.flock(port, fcntl.LOCK_EX)
print("ready", flush=True)
sys.stdin.read()
"""


@contextlib.contextmanager
def program_with(path: str, *how: str) -> Iterator[subprocess.Popen[bytes]]:
    """Another program that has a port open, until the end of the block or of its input.

    Args:
        how: name of the mode of os.open(), and "lock" for one that locks it.
    """
    command = tied([sys.executable, "-c", HAVING, path, *how])
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == b"ready\n"
        try:
            yield program
        finally:
            program.communicate()
