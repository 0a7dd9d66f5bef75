"""A recording for any other program: `imuscope replay FILE [--tcp [HOST]:PORT | --udp HOST:PORT | --pty]`.

    $ imuscope replay drive.mcap --tcp :4000          waits for who connects, then sends; to all who are there
    tcp://127.0.0.1:4000
    $ imuscope replay drive.mcap --udp 10.0.0.7:5000  a datagram for each chunk, as it came
    $ imuscope replay drive.mcap --pty                a serial port of its own; begins when somebody has opened it
    /dev/pts/7

What is sent are the original bytes at their original pace (`--speed`, `--loop`, `--from`, `--to`, `--device`). Whoever
does not take them holds the replay up, nothing is left out: the clock stands still meanwhile. What comes back is read
and thrown away. The address on standard output is what another imuscope takes as a source.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import pty
import select
import signal
import socket
import struct
import termios
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TextIO

from recordings.importers import open_file
from recordings.mcap_writer import RecordingError
from recordings.replay import ReplayClock, extent
from recordings.sources import Source
from server.links.base import steady_clock
from server.links.reader_thread import write_all

LONGEST_DATAGRAM = 65_507
HELD_NS = 50_000_000  # a send that takes longer holds the clock
QUIET_LOOKS = 10
STUCK_S = 10.0  # a client that takes nothing for so long is let go
OPENED_S = 0.3  # programs that open a port throw away what is in it
LOOK_S = 0.02


class ReplayError(Exception):
    """Why it cannot be played, in one sentence."""


class Sink(Protocol):
    """Where bytes go.

    Attributes:
        place: as a source of another imuscope.
    """

    place: str

    async def ready(self) -> None:
        """Somebody is there."""

    async def send(self, data: bytes) -> None: ...

    async def close(self) -> None:
        """After what was sent has been taken."""


@dataclass(frozen=True, slots=True)
class ReplayRequest:
    """What is to be played, and where to.

    Args:
        to: makes the sink.
        begin_s, end_s: seconds from the beginning of the file.
        device: of the file; "" for the only one.
    """

    path: Path
    to: Callable[[], Sink]
    protocol: str = ""
    speed: float = 1.0
    loop: bool = False
    begin_s: float = 0.0
    end_s: float | None = None
    device: str = ""


async def replay(wish: ReplayRequest, out: TextIO) -> int:
    """Play to the end, or until SIGINT or SIGTERM; how many bytes were sent.

    Raises:
        ReplayError: the file cannot be played so, or there is no such place.
    """
    made = _replay(wish)
    try:
        sink = wish.to()
    except OSError as error:
        raise ReplayError(f"The place to send to cannot be used: {error.strerror or error}.") from None
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    playing = loop.create_task(_play(made, sink, out))
    stopping = loop.create_task(stop.wait())
    await asyncio.wait((playing, stopping), return_when=asyncio.FIRST_COMPLETED)
    stopping.cancel()
    if not playing.done():
        playing.cancel()
    try:
        with contextlib.suppress(asyncio.CancelledError):
            return await playing
        return 0
    finally:
        await sink.close()


def _replay(wish: ReplayRequest) -> ReplayClock:
    try:
        file = open_file(wish.path, wish.protocol)
        span = extent(file)
    except RecordingError as error:
        raise ReplayError(f"{error.message} {error.hint}".rstrip()) from None
    if span is None:
        raise ReplayError(f"{wish.path.name} holds no bytes of a device.")
    stop_ns = span[1] + 1 if wish.end_s is None else span[0] + round(wish.end_s * 1e9)
    start_ns = span[0] + round(wish.begin_s * 1e9)
    if not start_ns < stop_ns or start_ns > span[1]:
        raise ReplayError(f"{wish.path.name} lasts {(span[1] - span[0]) / 1e9:.3f} s; nothing lies in that range.")
    return ReplayClock(
        file,
        steady_clock(),
        speed=wish.speed,
        loop=wish.loop,
        start_ns=start_ns,
        stop_ns=stop_ns,
        devices=[chosen(file, wish.device)],
    )


def chosen(file: Source, device: str) -> str:
    """Whose bytes are played.

    Raises:
        ReplayError: there is no such device, or there are several and none was named.
    """
    known = list(file.devices)
    listed = ", ".join(f"{one.id} ({one.about.get('name') or one.protocol or '?'})" for one in file.devices.values())
    if device and device not in known:
        raise ReplayError(f"{file.path.name} holds no device {device!r}; there are: {listed}.")
    if not device and len(known) > 1:
        raise ReplayError(f"{file.path.name} holds several devices; name one with --device: {listed}.")
    return device or (known[0] if known else "1")


async def _play(replay: ReplayClock, sink: Sink, out: TextIO) -> int:
    print(sink.place, file=out, flush=True)
    replay.pause()
    await sink.ready()
    replay.play()
    clock = steady_clock()
    sent = 0
    while (wait_ns := replay.wait_ns()) is not None:
        await asyncio.sleep(wait_ns / 1e9)
        for one in replay.take(64):
            began = clock()
            await sink.send(one.data)
            sent += len(one.data)
            if clock() - began > HELD_NS:
                replay.held()
    return sent


class TcpSink:
    """Listens; sends to all who are connected, from when the first one is."""

    def __init__(self, host: str, port: int) -> None:
        self._listener = socket.create_server((host or "127.0.0.1", port))
        name, number = self._listener.getsockname()[:2]
        self.place = f"tcp://{name}:{number}"
        self._writers: list[asyncio.StreamWriter] = []
        self._somebody = asyncio.Event()
        self._server: asyncio.Server | None = None

    async def ready(self) -> None:
        self._server = await asyncio.start_server(self._came, sock=self._listener)
        await self._somebody.wait()

    async def _came(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        self._somebody.set()
        with contextlib.suppress(OSError):
            while await reader.read(4096):
                pass

    async def send(self, data: bytes) -> None:
        for writer in list(self._writers):
            try:
                writer.write(data)
                await asyncio.wait_for(writer.drain(), STUCK_S)
            except (OSError, TimeoutError):
                self._writers.remove(writer)
                writer.close()

    async def close(self) -> None:
        for writer in self._writers:
            writer.close()
            with contextlib.suppress(OSError, TimeoutError):
                await asyncio.wait_for(writer.wait_closed(), STUCK_S)
        if self._server is not None:
            self._server.close()
        self._listener.close()


class UdpSink:
    """A datagram for each chunk. Nobody there is nobody's fault: it goes on."""

    def __init__(self, host: str, port: int) -> None:
        kind, _, _, _, address = socket.getaddrinfo(host or "127.0.0.1", port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(kind, socket.SOCK_DGRAM)
        self._socket.connect(address)
        self._socket.setblocking(False)
        self.place = f"udp://:{port}"

    async def ready(self) -> None:
        return

    async def send(self, data: bytes) -> None:
        loop = asyncio.get_running_loop()
        for at in range(0, len(data), LONGEST_DATAGRAM):
            with contextlib.suppress(ConnectionError):
                await loop.sock_sendall(self._socket, data[at : at + LONGEST_DATAGRAM])

    async def close(self) -> None:
        self._socket.close()


class PtySink:
    """A pseudo-terminal. Nobody's end is closed first, so that poll(2) tells when somebody has opened it."""

    def __init__(self) -> None:
        self._master, slave = pty.openpty()
        self.place = os.ttyname(slave)
        self._slave = -1
        os.close(slave)
        os.set_blocking(self._master, False)

    async def ready(self) -> None:
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        while any(event & select.POLLHUP for _, event in poll.poll(0)):
            await asyncio.sleep(LOOK_S)
        self._slave = os.open(self.place, os.O_RDWR | os.O_NOCTTY)  # kept: a reader that goes is waited for
        tty.setraw(self._slave)
        await asyncio.sleep(OPENED_S)
        asyncio.get_running_loop().add_reader(self._master, self._throw_away)

    def _throw_away(self) -> None:
        with contextlib.suppress(OSError):
            os.read(self._master, 4096)

    async def send(self, data: bytes) -> None:
        while True:
            with contextlib.suppress(TimeoutError):
                await write_all(self._master, data, timeout_s=3600)
                return

    async def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._master)
        if self._slave >= 0:
            # Between what the kernel holds back and what it offers, nothing is offered for a moment: look again.
            end, quiet = asyncio.get_running_loop().time() + STUCK_S, 0
            while quiet < QUIET_LOOKS and asyncio.get_running_loop().time() < end:
                quiet = 0 if self._unread() else quiet + 1
                await asyncio.sleep(LOOK_S)
            os.close(self._slave)
        os.close(self._master)

    def _unread(self) -> int:
        """Bytes that nobody has read yet."""
        answer = fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4))
        return int(struct.unpack("i", answer)[0])


def address(text: str) -> tuple[str, int]:
    """HOST:PORT, [HOST]:PORT or :PORT.

    Raises:
        ReplayError: it is none.
    """
    host, colon, port = text.rpartition(":")
    if not colon or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise ReplayError(f"{text!r} is not a valid address; write it as HOST:PORT.")
    return host.removeprefix("[").removesuffix("]"), int(port)
