"""Replay of a recording to any other program: `imuscope replay FILE [--tcp [HOST]:PORT | --udp HOST:PORT | --pty]`.

    $ imuscope replay drive.mcap --tcp :4000          waits for a client, then sends to all connected clients
    tcp://127.0.0.1:4000
    $ imuscope replay drive.mcap --udp 10.0.0.7:5000  one datagram for each recorded chunk
    $ imuscope replay drive.mcap --pty                a new serial port; starts when a program opens it
    /dev/pts/7

The original bytes are sent with their original timing (`--speed`, `--loop`, `--from`, `--to`, `--device`). A receiver
that stalls pauses the replay clock; no bytes are skipped. Bytes from the receiver are read and discarded. Another
imuscope accepts the address on standard output as a source.
"""

import asyncio
import contextlib
import fcntl
import os
import pty
import select
import socket
import struct
import termios
import tty
from collections.abc import Callable
from typing import Protocol, TextIO

from imuscope.recordings.replay import ReplayClock, ReplayedChunk, extent
from imuscope.recordings.sources import Source
from imuscope.server.errors import UsageError
from imuscope.server.links.base import steady_clock
from imuscope.server.links.reader_thread import write_all
from imuscope.server.system.end_signals import end_signals

LONGEST_DATAGRAM = 65_507
STALL_NS = 50_000_000  # a send that takes longer pauses the replay clock
QUIET_POLLS = 10
STUCK_S = 10.0  # a client that accepts no data for this long is disconnected
OPENED_S = 0.3  # programs discard the bytes in a port when they open it
POLL_S = 0.02


class Sink(Protocol):
    """Destination of replayed bytes.

    Attributes:
        place: its address, as a source for another imuscope.
    """

    place: str

    async def wait_ready(self) -> None:
        """Wait until a receiver is connected."""

    async def send(self, data: bytes) -> None: ...

    async def close(self) -> None:
        """Close after the receiver has taken all bytes."""


async def replay(clock: ReplayClock, to: Callable[[], Sink], out: TextIO) -> int:
    """Play to the end, or until a signal that ends the program. Returns the number of bytes sent.

    Args:
        to: creates the sink.

    Raises:
        UsageError, RecordingError: the file cannot be played, or the destination cannot be used.
    """
    try:
        sink = to()
    except OSError as error:
        raise UsageError(f"The destination cannot be used: {error.strerror or error}.") from None
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in end_signals():
        loop.add_signal_handler(number, stop.set)
    playing = loop.create_task(_play(clock, sink, out))
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


def replay_clock(
    file: Source, device: str, begin_s: float, end_s: float | None, *, speed: float, loop: bool
) -> ReplayClock:
    """Plays one device of a file.

    Args:
        device: device in the file; "" for the only one.
        begin_s, end_s: seconds from the beginning of the file.

    Raises:
        UsageError: it cannot be played.
    """
    span = extent(file)
    if span is None:
        raise UsageError(f"{file.path.name} has no device bytes.")
    stop_ns = span[1] + 1 if end_s is None else span[0] + round(end_s * 1e9)
    start_ns = span[0] + round(begin_s * 1e9)
    if not start_ns < stop_ns or start_ns > span[1]:
        raise UsageError(f"{file.path.name} lasts {(span[1] - span[0]) / 1e9:.3f} s; that range is empty.")
    devices = [choose_device(file, device)]
    return ReplayClock(
        file, steady_clock(), speed=speed, loop=loop, start_ns=start_ns, stop_ns=stop_ns, devices=devices
    )


def choose_device(file: Source, device: str) -> str:
    """Device whose bytes are replayed.

    Raises:
        UsageError: unknown device, or several devices and none named.
    """
    known = list(file.devices)
    listed = ", ".join(f"{one.id} ({one.identity.get('name') or one.protocol or '?'})" for one in file.devices.values())
    if device and device not in known:
        raise UsageError(f"{file.path.name} has no device {device!r}; it has: {listed}.")
    if not device and len(known) > 1:
        raise UsageError(f"{file.path.name} has several devices; name one with --device: {listed}.")
    return device or (known[0] if known else "1")


async def _play(replay: ReplayClock, sink: Sink, out: TextIO) -> int:
    print(sink.place, file=out, flush=True)
    replay.pause()
    await sink.wait_ready()
    replay.play()
    clock = steady_clock()
    sent = 0
    while (wait_ns := replay.wait_ns()) is not None:
        await asyncio.sleep(wait_ns / 1e9)
        for one in _due_chunks(replay):
            began = clock()
            await sink.send(one.data)
            sent += len(one.data)
            if clock() - began > STALL_NS:
                replay.note_stall()
    return sent


def _due_chunks(replay: ReplayClock) -> list[ReplayedChunk]:
    """Chunks that are due.

    Raises:
        UsageError, RecordingError: the file has changed, or is gone: each turn of a loop opens it again.
    """
    try:
        return replay.due_chunks(64)
    except OSError as error:
        raise UsageError(f"The file cannot be read any more: {(error.strerror or 'it failed').lower()}.") from None


class TcpSink:
    """TCP server that sends to all connected clients and starts when the first connects."""

    def __init__(self, host: str, port: int) -> None:
        self._listener = socket.create_server((host or "127.0.0.1", port))
        name, number = self._listener.getsockname()[:2]
        self.place = f"tcp://{name}:{number}"
        self._writers: list[asyncio.StreamWriter] = []
        self._connected = asyncio.Event()
        self._server: asyncio.Server | None = None

    async def wait_ready(self) -> None:
        self._server = await asyncio.start_server(self._on_connection, sock=self._listener)
        await self._connected.wait()

    async def _on_connection(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        self._connected.set()
        with contextlib.suppress(OSError):
            while await reader.read(4096):
                pass

    async def send(self, data: bytes) -> None:
        for writer in list(self._writers):
            try:
                writer.write(data)
                async with asyncio.timeout(STUCK_S):
                    await writer.drain()
            except (OSError, TimeoutError):
                self._writers.remove(writer)
                writer.close()

    async def close(self) -> None:
        for writer in self._writers:
            writer.close()
            with contextlib.suppress(OSError, TimeoutError):
                async with asyncio.timeout(STUCK_S):
                    await writer.wait_closed()
        if self._server is not None:
            self._server.close()
        self._listener.close()


class UdpSink:
    """UDP sender: one datagram for each chunk. It continues without a receiver, and without a network."""

    def __init__(self, host: str, port: int) -> None:
        kind, _, _, _, address = socket.getaddrinfo(host or "127.0.0.1", port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(kind, socket.SOCK_DGRAM)
        self._socket.connect(address)
        self._socket.setblocking(False)
        self.place = f"udp://:{port}"

    async def wait_ready(self) -> None:
        return

    async def send(self, data: bytes) -> None:
        loop = asyncio.get_running_loop()
        for at in range(0, len(data), LONGEST_DATAGRAM):
            with contextlib.suppress(OSError):
                await loop.sock_sendall(self._socket, data[at : at + LONGEST_DATAGRAM])

    async def close(self) -> None:
        self._socket.close()


class PtySink:
    """A pseudo-terminal. The slave end is closed first, so that poll(2) detects when a program opens it."""

    def __init__(self) -> None:
        self._master, slave = pty.openpty()
        self.place = os.ttyname(slave)
        self._slave = -1
        os.close(slave)
        os.set_blocking(self._master, False)

    async def wait_ready(self) -> None:
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        while any(event & select.POLLHUP for _, event in poll.poll(0)):
            await asyncio.sleep(POLL_S)
        self._slave = os.open(
            self.place, os.O_RDWR | os.O_NOCTTY
        )  # kept open, so that the replay waits if the reader closes it
        tty.setraw(self._slave)
        await asyncio.sleep(OPENED_S)
        asyncio.get_running_loop().add_reader(self._master, self._discard_input)

    def _discard_input(self) -> None:
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
            await self._drained()
            os.close(self._slave)
        os.close(self._master)

    async def _drained(self) -> None:
        """Wait until the receiver has read all bytes, or nothing for a while: closing the master discards the rest."""
        clock = asyncio.get_running_loop().time
        poll = select.poll()
        poll.register(self._slave, select.POLLIN)
        end, quiet, before = clock() + STUCK_S, 0, -1
        while quiet < QUIET_POLLS and clock() < end:
            # waits for bytes that the kernel is moving between its buffers; FIONREAD returns 0 during that time
            poll.poll(0)
            unread = self._backlog()
            if unread != before:
                end, before = clock() + STUCK_S, unread
            quiet = 0 if unread else quiet + 1
            await asyncio.sleep(POLL_S)

    def _backlog(self) -> int:
        """Number of unread bytes in the receiver's buffer."""
        answer = fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4))
        return int(struct.unpack("i", answer)[0])


def address(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT, [HOST]:PORT or :PORT.

    Raises:
        UsageError: not a valid address.
    """
    host, colon, port = text.rpartition(":")
    if not colon or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"{text!r} is not a valid address; write it as HOST:PORT.")
    return host.removeprefix("[").removesuffix("]"), int(port)
