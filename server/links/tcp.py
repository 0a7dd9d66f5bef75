"""TCP, both ways round: connect to a device server, or wait for a device that connects to us.

    tcp://host:port           we connect: serial device servers, a robot's own bridge
    tcp-listen://[host]:port  the device connects: modules that are configured with our address

A peer that loses power says nothing: the connection just stays silent. Keep-alive asks after `KEEP_IDLE_S` of silence
and gives up after `KEEP_COUNT` unanswered questions, so a dead peer is seen within seconds instead of the two hours
that are the default. Nagle's delay is off: a command is a small packet that should leave at once.

The listener serves one device at a time. A second one is turned away while the first one talks; once the first one has
been silent for `SILENT_NS` the new one takes its place, because that is what a device looks like that restarted and
came back before its old connection was known to be dead.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket

from server.links.base import Chunk, LinkError, LinkSettings, Progress
from server.links.reader_thread import READ_BYTES, ThreadedLink, closed, write_all
from server.links.text import heading, listen_error, place_of, progress_line

KEEP_IDLE_S, KEEP_EVERY_S, KEEP_COUNT = 2, 1, 3
SILENT_NS = 1_000_000_000


def set_socket_options(connection: socket.socket) -> None:
    """No delay, no blocking, and a dead peer is noticed within seconds."""
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    timeout_ms = 1000 * (KEEP_IDLE_S + KEEP_EVERY_S * KEEP_COUNT)
    wishes = {"TCP_KEEPIDLE": KEEP_IDLE_S, "TCP_KEEPINTVL": KEEP_EVERY_S, "TCP_KEEPCNT": KEEP_COUNT}
    for name, value in (*wishes.items(), ("TCP_USER_TIMEOUT", timeout_ms)):
        option = getattr(socket, name, None)  # not every system has each
        if option is not None:
            connection.setsockopt(socket.IPPROTO_TCP, option, value)


class _Connection(ThreadedLink):
    """What both ways round have in common."""

    @property
    def waits(self) -> bool:
        """TCP holds a sender back by itself. But one who is recorded is never held back for who only looks."""
        return not self.flow.arrivals


class TcpLink(_Connection):
    """A connection that we make."""

    kind = "tcp"

    def __init__(self, source: str, settings: LinkSettings, host: str, port: int) -> None:
        super().__init__(source, settings)
        self.host, self.port = host, port
        self._socket: socket.socket | None = None

    @property
    def place(self) -> str:
        return place_of(self.host, self.port)

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        try:
            async with asyncio.timeout(self.settings.connect_timeout_s):
                self._socket = await self._connect()
        except TimeoutError:
            error = self._no_answer()
        except socket.gaierror as failure:
            hint = "Check the spelling, or give the address as numbers."
            error = LinkError("not-found", f"No host is known as {self.host!r} ({failure.strerror}).", hint)
        except OSError as failure:
            error = self._refused(failure)
        else:
            progress_line(progress, self.place, "connected")
            self._start(self._socket.fileno(), self._on_readable)
            return
        progress_line(progress, self.place, error.message)
        raise error

    async def _connect(self) -> socket.socket:
        """Try every address of the host; the last failure is the one reported."""
        loop = asyncio.get_running_loop()
        failure: OSError = OSError(errno.EADDRNOTAVAIL, "no address")
        for family, kind, protocol, _, address in await loop.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM):
            connection = socket.socket(family, kind, protocol)
            try:
                set_socket_options(connection)
                await loop.sock_connect(connection, address)
                return connection
            except OSError as error:
                connection.close()
                failure = error
            except BaseException:
                connection.close()
                raise
        raise failure

    def _no_answer(self) -> LinkError:
        seconds = self.settings.connect_timeout_s
        hint = "Is the host switched on and in this network? A firewall may swallow the question."
        return LinkError("refused", f"{self.place} did not answer within {seconds:g} s.", hint)

    def _refused(self, error: OSError) -> LinkError:
        if error.errno == errno.ECONNREFUSED:
            hint = "The host is there; is its server running, and is this the port?"
            return LinkError("refused", f"Nothing listens at {self.place}.", hint)
        return LinkError("refused", f"{self.place} cannot be reached: {error.strerror}.", "Is the network up?")

    def _on_readable(self) -> None:
        assert self._socket is not None
        assert self._inbox is not None
        try:
            data = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            raise self._gone(error) from None
        arrival_ns = self.settings.now_ns()
        if not data:
            raise LinkError(
                "gone", f"{self.place} closed the connection.", "It is connected again as soon as it answers."
            )
        self._inbox.put(Chunk(data, arrival_ns))

    def _gone(self, error: OSError) -> LinkError:
        hint = "Was it switched off, or the network cut? It is connected again as soon as it answers."
        return LinkError("gone", f"The connection to {self.place} broke: {error.strerror}.", hint)

    async def write(self, data: bytes) -> None:
        if self._socket is None:
            raise closed(self.source)
        try:
            await write_all(self._socket.fileno(), data)
        except TimeoutError:
            raise LinkError("refused", f"{self.place} took no bytes for 5 s.", "Is the device stuck?") from None
        except OSError as error:
            raise self._gone(error) from None

    async def _free(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class TcpListenLink(_Connection):
    """A port at which a device may connect.

    Attributes:
        address: where it really listens, once open (port 0 asks for any free one).
        peer: who is connected, "" for nobody.
    """

    kind = "tcp-listen"

    def __init__(self, source: str, settings: LinkSettings, host: str, port: int) -> None:
        super().__init__(source, settings)
        self.host, self.port = host, port
        self.address: tuple[str, int] = (host, port)
        self.peer = ""
        self._listener: socket.socket | None = None
        self._device: socket.socket | None = None
        self._last_ns = 0

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        try:
            family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
            self._listener = socket.create_server((self.host, self.port), family=family, backlog=4)
        except OSError as error:
            raise listen_error(self.kind, self.host, self.port, error) from None
        self._listener.setblocking(False)
        self.address = self._listener.getsockname()[:2]
        self._tell_waiting()
        progress_line(progress, place_of(*self.address), "waiting for a device to connect")
        self._start(self._listener.fileno(), self._on_newcomer)

    def _tell_waiting(self) -> None:
        self.notices = [f"Waiting for a device to connect to {heading(*self.address)}."]

    def _on_newcomer(self) -> None:
        assert self._listener is not None
        assert self._pump is not None
        try:
            newcomer, address = self._listener.accept()
        except OSError:
            return  # it gave up before we came to it
        who = place_of(*address[:2])
        if self._device is not None:
            if self.settings.now_ns() - self._last_ns < SILENT_NS:
                self.notices = [
                    f"{self.peer} is connected.",
                    f"{who} was turned away: one device at a time. Give the other one a port of its own.",
                ]
                newcomer.close()  # after the notice: who is turned away may look for it at once
                return
            before = self.peer
            self._drop()
            self.notices = [f"{who} is connected; it took the place of {before}, which had gone silent."]
        else:
            self.notices = [f"{who} is connected."]
        set_socket_options(newcomer)
        self._device, self.peer, self._last_ns = newcomer, who, self.settings.now_ns()
        self._pump.watch(newcomer.fileno(), self._on_readable)

    def _on_readable(self) -> None:
        assert self._inbox is not None
        if self._device is None:
            return  # replaced in the same round of the selector
        try:
            data = self._device.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            raise self._gone(f"broke: {error.strerror}") from None
        self._last_ns = self.settings.now_ns()
        if not data:
            raise self._gone("was closed by the device")
        self._inbox.put(Chunk(data, self._last_ns))

    def _gone(self, how: str) -> LinkError:
        where = heading(*self.address)
        return LinkError("gone", f"The connection of {self.peer} {how}.", f"The device may connect to {where} again.")

    def _drop(self) -> None:
        """Let go of the device that is connected; in the reading thread, or after its end."""
        device, self._device, self.peer = self._device, None, ""
        if device is not None:
            if self._pump is not None:
                self._pump.forget(device.fileno())
            device.close()

    async def write(self, data: bytes) -> None:
        device = self._device
        if device is None:
            raise LinkError("gone", "No device is connected.", f"It may connect to {heading(*self.address)}.")
        try:
            await write_all(device.fileno(), data)
        except TimeoutError:
            raise LinkError("refused", f"{self.peer} took no bytes for 5 s.", "Is the device stuck?") from None
        except OSError as error:
            raise self._gone(f"broke: {error.strerror}") from None

    async def _free(self) -> None:
        self._drop()
        if self._listener is not None:
            with contextlib.suppress(OSError):
                self._listener.close()
            self._listener = None
