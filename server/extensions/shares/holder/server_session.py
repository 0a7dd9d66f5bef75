"""The server at a holder: one at a time, its connection, what it sends to the device, and the answers to it.

What it sends while a client has the voice waits, for MOST_WAIT_S; then it is refused, with who had the voice.
"""

from __future__ import annotations

import _socket
import contextlib
import errno
import fcntl
import os
from collections.abc import Callable, Mapping

from imuscope.server.extensions.shares.holder.clients import Client
from imuscope.server.extensions.shares.holder.event_loop import READ, WRITE, EventLoop
from imuscope.server.extensions.shares.holder.messages import CLIENT, VERSION, MessageKind, json_message, message
from imuscope.server.extensions.shares.holder.server_connection import ServerConnection
from imuscope.server.extensions.shares.holder.shares import ShareError
from imuscope.server.system.light_modules import Any, NamedTuple, Socket

MOST_BEHIND = 8 << 20  # bytes waiting for a server that does not read, beyond which it is disconnected
MOST_WAIT_S = 10.0
OTHER_HOLDER = "another holder has this port; end it first, or use its shares"


class WaitingWrite(NamedTuple):
    """Bytes of the server that wait for the voice until a time, monotonic s."""

    number: int
    data: bytes
    until: float


class ServerSide:
    """The connection to the server, if there is one.

    Args:
        path: of the Unix socket.
        about: of the first message ("source").
        on_message: carries out a message.
        on_gone: called when the server has left.
        state: the whole state.
    """

    def __init__(
        self,
        path: str,
        about: Mapping[str, Any],
        loop: EventLoop,
        *,
        on_message: Callable[[MessageKind, bytes], None],
        on_gone: Callable[[], None],
        state: Callable[[], dict[str, Any]],
    ) -> None:
        self._path, self._about, self._loop = path, about, loop
        self._on_message, self._on_gone, self._state = on_message, on_gone, state
        self._accepting: Socket | None = None
        self._link = ""
        self.connection: ServerConnection | None = None
        self.writes: list[WaitingWrite] = []

    def listen(self, link: str = "") -> None:
        """Be found from now on.

        Args:
            link: to the socket of another holder of the port, which was given another path of it; see port_link.

        Raises:
            ShareError: another holder has the port.
        """
        folder = os.open(os.path.dirname(self._path), os.O_RDONLY | os.O_CLOEXEC)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)  # of two that begin at once, one would remove the socket of the other
            if _answers(link):
                raise ShareError(OTHER_HOLDER)
            accepting = self._listening()
        finally:
            os.close(folder)
        self._accepting = accepting
        self._loop.watch(accepting.fileno(), READ, self._on_connects)

    def _listening(self) -> Socket:
        """A socket at the path; ShareError as `listen`."""
        path = self._path
        if _answers(path):
            raise ShareError(OTHER_HOLDER)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)  # of a holder that was killed
        accepting = Socket(_socket.AF_UNIX, _socket.SOCK_STREAM)
        before = os.umask(0o177)
        try:
            accepting.bind(path)
        finally:
            os.umask(before)
        accepting.listen(1)
        accepting.setblocking(False)
        return accepting

    def name(self, link: str) -> None:
        """Be found by this link to the socket too, and by none before; "": by none."""
        with contextlib.suppress(OSError):
            if self._link and os.readlink(self._link) == self._path:
                os.unlink(self._link)
        self._link = link
        if link:
            with contextlib.suppress(OSError):
                if os.path.lexists(link):
                    os.unlink(link)  # of a holder that was killed, or of a port that had this number before
                os.symlink(self._path, link)

    def _on_connects(self, _: int) -> None:
        assert self._accepting is not None
        try:
            connection, _peer = self._accepting.accept()
        except OSError:
            return
        hello = {"version": VERSION, "pid": os.getpid(), "busy": 0, **self._about}
        if self.connection is not None:  # one that is gone has closed its end
            with contextlib.suppress(OSError):
                connection.sendall(json_message(MessageKind.HELLO, hello | {"busy": self.connection.pid}))
            connection.close()
            return
        connection.setblocking(False)
        self.connection = ServerConnection(connection)
        self._loop.watch(connection.fileno(), READ, self._on_ready)
        self._send(json_message(MessageKind.HELLO, hello))
        self.send_state()

    def _on_ready(self, event: int) -> None:
        server = self.connection
        if server is None:
            return
        try:
            if event & WRITE:
                server.flush()
                self._expect(server)
            if event & ~WRITE:
                for kind, body in server.read():
                    self._on_message(kind, body)
        except BlockingIOError:
            return
        except OSError:
            self.disconnect()
        except Exception as error:  # whatever a server sends, the port stays open for all other clients
            print(f"the server sent nonsense: {error!r}", flush=True)
            self.disconnect()

    def disconnect(self) -> None:
        """End the connection. Idempotent."""
        server, self.connection = self.connection, None
        if server is not None:
            self._loop.forget(server.fd)
            server.close()
        self.writes.clear()
        self._on_gone()

    # ── to the server ────────────────────────────────────────────────────────────────────────────────────────────────

    def _expect(self, server: ServerConnection) -> None:
        self._loop.expect(server.fd, READ | (WRITE if server.backlog else 0))

    def _send(self, data: bytes) -> None:
        if self.connection is not None:
            self.connection.send(data)
            if self.connection.backlog:
                self._expect(self.connection)

    def pass_on(self) -> None:
        """Send the bytes of the device that were collected."""
        server = self.connection
        if server is not None:
            server.pass_on()
            if server.backlog > MOST_BEHIND:
                self.disconnect()
            elif server.backlog:
                self._expect(server)

    def on_client_data(self, stamp_ns: int, client: Client, data: bytes) -> None:
        """Report what a client sent."""
        self._send(message(MessageKind.CLIENT_DATA, CLIENT.pack(stamp_ns, client.number) + data))

    def send_state(self) -> None:
        """Send the whole state."""
        if self.connection is not None:
            self._send(json_message(MessageKind.STATE, self._state()))

    def done(self, number: int, error: str = "", *, kind: str = "", stamp_ns: int | None = None) -> None:
        """Answer a request; a write with the time at which it was carried out."""
        body: dict[str, Any] = {"id": number}
        if error:
            body |= {"error": error, "kind": kind}
        if stamp_ns is not None:
            body["at"] = stamp_ns
        self._send(json_message(MessageKind.DONE, body))

    # ── its writes ───────────────────────────────────────────────────────────────────────────────────────────────────

    def wait(self, number: int, data: bytes, now: float) -> None:
        """Let bytes wait for the voice."""
        self.writes.append(WaitingWrite(number, data, now + MOST_WAIT_S))

    def refuse_late(self, now: float) -> None:
        """Refuse writes that have waited too long, and those after them, or they would arrive without their
        beginning.
        """
        if self.writes and now > self.writes[0].until:
            self.refuse_all("another program is talking to the device", kind="busy")

    def refuse_all(self, why: str, *, kind: str) -> None:
        """Refuse what waits."""
        writes, self.writes = self.writes, []
        for one in writes:
            self.done(one.number, why, kind=kind)

    def close(self) -> None:
        """End everything."""
        self.disconnect()
        self.name("")
        if self._accepting is not None:
            with contextlib.suppress(OSError):
                os.unlink(self._path)  # first: then it cannot be that of a holder that begins
            self._accepting.close()


def _answers(path: str) -> bool:
    """Whether a holder listens at a path."""
    probe = Socket(_socket.AF_UNIX, _socket.SOCK_STREAM)
    probe.setblocking(False)
    try:
        return os.path.exists(path) and probe.connect_ex(path) in (0, errno.EAGAIN)  # EAGAIN: it is there, and busy
    finally:
        probe.close()
