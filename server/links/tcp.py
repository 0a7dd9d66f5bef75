"""TCP links in both directions: connect to a device server, or wait for a device that connects to us.

    tcp://host:port           we connect: serial device servers, a robot's own bridge
    tcp-listen://[host]:port  the device connects: modules that are configured with our address

A peer that loses power leaves the connection silent. Keep-alive probes are sent after `KEEP_IDLE_S` of silence, and
after `KEEP_COUNT` unanswered probes the connection ends, so a dead peer is detected within seconds instead of the
default two hours. Nagle's delay is off: a command is a small packet that should be sent at once.

The listener serves one device at a time. A second one is refused while the first one sends; if the first one has been
silent for `SILENT_NS`, the new one replaces it, because a restarted device reconnects before its old connection is
known to be dead.
"""

import asyncio
import contextlib
import errno
import socket

from imuscope.server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from imuscope.server.links.reader_thread import READ_BYTES, ThreadedLink, closed, write_all
from imuscope.server.links.registry import LinkDefinition, register_link
from imuscope.server.links.source_url import SourceUrl
from imuscope.server.links.text import heading, listen_error, place_of, progress_line

KEEP_IDLE_S, KEEP_EVERY_S, KEEP_COUNT = 2, 1, 3
SILENT_NS = 1_000_000_000


def set_socket_options(connection: socket.socket) -> None:
    """Set no delay, non-blocking mode, and detection of a dead peer within seconds."""
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    timeout_ms = 1000 * (KEEP_IDLE_S + KEEP_EVERY_S * KEEP_COUNT)
    options = {"TCP_KEEPIDLE": KEEP_IDLE_S, "TCP_KEEPINTVL": KEEP_EVERY_S, "TCP_KEEPCNT": KEEP_COUNT}
    for name, value in (*options.items(), ("TCP_USER_TIMEOUT", timeout_ms)):
        option = getattr(socket, name, None)  # not available on every system
        if option is not None:
            connection.setsockopt(socket.IPPROTO_TCP, option, value)


class _Connection(ThreadedLink):
    """Behaviour shared by both directions of connection."""

    @property
    def waits(self) -> bool:
        """True: TCP holds a sender back by itself. False while recording, so that a slow client does not delay it."""
        return not self.flow.arrivals


class TcpLink(_Connection):
    """A connection that this server opens."""

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
            error = LinkError("not-found", f"Host {self.host!r} not found ({failure.strerror}).", hint)
        except OSError as failure:
            error = self._refused(failure)
        else:
            progress_line(progress, self.place, "connected")
            self._start_loop(self._socket.fileno(), self._on_readable)
            return
        progress_line(progress, self.place, error.message)
        raise error

    async def _connect(self) -> socket.socket:
        """Try every address of the host; if all fail, the last failure is raised."""
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
        hint = "Check that the host is switched on and in this network. A firewall may drop the request."
        return LinkError("refused", f"{self.place} did not answer within {seconds:g} s.", hint)

    def _refused(self, error: OSError) -> LinkError:
        if error.errno == errno.ECONNREFUSED:
            hint = "The host is reachable; check the port, and that its server is running."
            return LinkError("refused", f"Nothing listens at {self.place}.", hint)
        return LinkError("refused", f"{self.place} cannot be reached: {error.strerror}.", "Check the network.")

    def _on_readable(self) -> None:
        assert self._socket is not None
        assert self._queue is not None
        try:
            data = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            raise self._on_hang_up(error) from None
        arrival_ns = self.settings.now_ns()
        if not data:
            raise LinkError(
                "gone", f"{self.place} closed the connection.", "It is connected again as soon as it answers."
            )
        self._queue.put(Chunk(data, arrival_ns))

    def _on_hang_up(self, error: OSError) -> LinkError:
        hint = "Check its power and the network. It is connected again as soon as it answers."
        return LinkError("gone", f"The connection to {self.place} broke: {error.strerror}.", hint)

    async def write(self, data: bytes) -> None:
        if self._socket is None:
            raise closed(self.source)
        try:
            await write_all(self._socket.fileno(), data)
        except TimeoutError:
            raise LinkError("refused", f"{self.place} accepted no bytes for 5 s.", "Check the device.") from None
        except OSError as error:
            raise self._on_hang_up(error) from None

    async def _release(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class TcpListenLink(_Connection):
    """A port at which a device may connect.

    Attributes:
        address: address in use once open (port 0 requests any free one).
        peer: address of the connected device; "" if none is connected.
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
        self.notices = [f"Waiting for a device to connect to {heading(*self.address)}."]
        progress_line(progress, place_of(*self.address), "waiting for a device to connect")
        self._start(self._listener.fileno(), self._on_newcomer)

    def _on_newcomer(self) -> None:
        assert self._listener is not None
        assert self._reader is not None
        try:
            newcomer, address = self._listener.accept()
        except OSError:
            return  # it disconnected before it was accepted
        who = place_of(*address[:2])
        if self._device is not None:
            if self.settings.now_ns() - self._last_ns < SILENT_NS:
                self.notices = [
                    f"{self.peer} is connected.",
                    f"{who} was turned away: one device at a time. Give the other one its own port.",
                ]
                newcomer.close()  # after the notice is set, which may be read as soon as this connection ends
                return
            before = self.peer
            self._drop()
            self.notices = [f"{who} is connected; it took the place of {before}, which had gone silent."]
        else:
            self.notices = [f"{who} is connected."]
        set_socket_options(newcomer)
        self._device, self.peer, self._last_ns = newcomer, who, self.settings.now_ns()
        self._reader.watch(newcomer.fileno(), self._on_readable)

    def _on_readable(self) -> None:
        assert self._queue is not None
        if self._device is None:
            return  # replaced in the same pass of the selector
        try:
            data = self._device.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            raise self._on_hang_up(f"broke: {error.strerror}") from None
        self._last_ns = self.settings.now_ns()
        if not data:
            raise self._on_hang_up("was closed by the device")
        self._queue.put(Chunk(data, self._last_ns))

    def _on_hang_up(self, how: str) -> LinkError:
        where = heading(*self.address)
        return LinkError("gone", f"The connection of {self.peer} {how}.", f"The device may connect to {where} again.")

    def _drop(self) -> None:
        """Disconnect the device; called in the reading thread, or after its end."""
        device, self._device, self.peer = self._device, None, ""
        if device is not None:
            if self._reader is not None:
                self._reader.forget(device.fileno())
            device.close()

    async def write(self, data: bytes) -> None:
        device = self._device
        if device is None:
            raise LinkError("gone", "No device is connected.", f"It may connect to {heading(*self.address)}.")
        try:
            await write_all(device.fileno(), data)
        except TimeoutError:
            raise LinkError("refused", f"{self.peer} accepted no bytes for 5 s.", "Check the device.") from None
        except OSError as error:
            raise self._on_hang_up(f"broke: {error.strerror}") from None

    async def _release(self) -> None:
        self._drop()
        if self._listener is not None:
            with contextlib.suppress(OSError):
                self._listener.close()
            self._listener = None


def _open_connection(source: str, settings: LinkSettings, parsed: SourceUrl) -> Link:
    parsed.allow(())
    return TcpLink(source, settings, *parsed.address(listening=False))


def _open_listener(source: str, settings: LinkSettings, parsed: SourceUrl) -> Link:
    parsed.allow(())
    return TcpListenLink(source, settings, *parsed.address(listening=True))


register_link(
    LinkDefinition(
        "tcp",
        "TCP",
        _open_connection,
        "tcp://host:port",
        usage=(("tcp://host:port", "connect to a device server"),),
        examples=lambda: [("tcp://192.168.1.20:2000", "a serial server or a device on the network")],
        shareable=True,
        order=10,
        network=True,
    )
)
register_link(
    LinkDefinition(
        "tcp-listen",
        "TCP, waiting",
        _open_listener,
        "tcp-listen://:port",
        usage=(("tcp-listen://[host]:port", "wait for a device to connect"),),
        examples=lambda: [("tcp-listen://:2000", "wait for a device to connect")],
        order=20,
        network=True,
    )
)
