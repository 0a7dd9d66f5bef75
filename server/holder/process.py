"""The loop of the holder.

    port ──read, stamp──┬── clients: at once                 the robot's driver comes first
                        └── server: every SERVER_S           its samples carry the stamp

A port that is gone is opened again, as a link is. Meanwhile its terminals and TCP ports are closed: a client sees what
an unplugged adapter would show. Started by a server, the holder ends when neither a server nor a client has been there
for GRACE_S; with `stay`, only by a signal.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import select
import socket
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

from server.backoff import Backoff
from server.holder.arbiter import SERVER, Arbiter
from server.holder.clients import Client, Share, make_share
from server.holder.messages import CLIENT, VERSION, MessageError, MessageKind, json_message, message
from server.holder.port import MOST_WAITING, Port, PortError
from server.holder.queues import FrameSize
from server.holder.requests import carry_out
from server.holder.server_connection import ServerConnection
from server.holder.settings import HolderSettings
from server.holder.shares import ShareAddress, ShareError

TICK_S = 0.02
STATE_S = 1.0
SERVER_BYTES = 1 << 15  # collected for the server before SERVER_S is over
MOST_BEHIND = 8 << 20  # bytes waiting for a server that does not read, beyond which it is disconnected
GRACE_S = 10.0
FIRST_RETRY_S, LAST_RETRY_S = 0.5, 10.0
READ, WRITE = select.EPOLLIN, select.EPOLLOUT


class Holder:
    """One port and everybody at it."""

    def __init__(self, settings: HolderSettings) -> None:
        self._settings = settings
        self.port = Port(settings.source)
        self.arbiter = Arbiter()
        self._epoll = select.epoll()
        self._handlers: dict[int, Callable[[int], None]] = {}
        self._shares: list[Share] = [make_share(one, self._next_number) for one in settings.shares]
        self._clients: dict[int, Client] = {}  # by descriptor
        self._paused: set[int] = set()  # descriptors of clients that wait for the voice
        self._numbers = 0
        self._server: ServerConnection | None = None
        self._listener = -1
        self._accepting: socket.socket | None = None
        self._frame_size: FrameSize | None = None
        self._backoff = Backoff(FIRST_RETRY_S, LAST_RETRY_S)
        self._error: PortError | None = None
        self._retry_at = 0.0
        self._state_at = 0.0
        self._changed = True
        self._last_company = time.monotonic()
        self._writes: list[tuple[int, bytes]] = []  # of the server, waiting for the voice
        self._ended = False

    # ── the loop ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def run(self, ready: Callable[[], None]) -> None:
        """Hold the port until a signal, or until nobody needs it.

        Args:
            ready: called when a server can connect and all shares are offered.

        Raises:
            OSError: another holder has the socket.
            ShareError: a share cannot be offered.
        """
        self._listen()
        try:
            for share in self._shares:
                self._offer(share)  # also if the port is not there: what is wrong is told at once
            self._open_port()
            if not self.port.is_open:
                for share in self._shares:
                    self._withdraw(share)
            ready()
            poll, handlers = self._epoll.poll, self._handlers
            next_tick = time.monotonic() + TICK_S
            while not self._ended:
                now = time.monotonic()
                if now >= next_tick:
                    self._tick(now)
                    next_tick = now + TICK_S
                server = self._server
                until = next_tick if server is None or not server.due_at else min(next_tick, server.due_at)
                for fd, event in poll(max(0.0, until - now)):
                    handler = handlers.get(fd)
                    if handler is not None:
                        handler(event)
                server = self._server
                if server is not None and server.due_at and time.monotonic() >= server.due_at:
                    self._to_server()
        finally:
            self._close()

    def end(self, *_: Any) -> None:
        """End the loop; a signal handler."""
        self._ended = True

    def _watch(self, fd: int, events: int, handler: Callable[[int], None]) -> None:
        self._handlers[fd] = handler
        self._epoll.register(fd, events)

    def _forget(self, fd: int) -> None:
        if self._handlers.pop(fd, None) is not None:
            with contextlib.suppress(OSError):
                self._epoll.unregister(fd)

    def _tick(self, now: float) -> None:
        for share in self._shares:
            came, left = share.look()
            self._follow_rate(share)
            if left is not None:
                self._left(left)
            if came is not None:
                self._came(share, came)
        if not self.port.is_open and now >= self._retry_at:
            self._open_port()
        self._speak_next(now)
        if self._changed or now >= self._state_at:
            self._send_state(now)
        if self._server is not None or self._clients or self._settings.stay:
            self._last_company = now
        elif now - self._last_company > GRACE_S:
            self._ended = True

    def _follow_rate(self, share: Share) -> None:
        """Take the port to the rate that a client set after it has talked to the device; before, it says nothing."""
        for client in share.clients:
            before, client.last_baud = client.last_baud, client.baud
            changed = client.baud is not None and before is not None and client.baud != before
            if changed and client.may_write and client.received and client.baud != self.port.baud:
                with contextlib.suppress(PortError):
                    self.port.set_baud(client.baud or 0)
                self._changed = True

    def _next_number(self) -> int:
        self._numbers += 1
        return self._numbers

    # ── the port ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def _open_port(self) -> None:
        try:
            self.port.open()
        except PortError as error:
            self._error = error
            self._retry_at = time.monotonic() + self._backoff.next()
            self._changed = True
            return
        self._error = None
        self._backoff.reset()
        self._watch(self.port.fd, READ, self._on_port)
        for share in self._shares:
            with contextlib.suppress(ShareError):  # it could be offered before
                self._offer(share)
        self._changed = True

    def _lost_port(self, error: PortError) -> None:
        self._forget(self.port.fd)
        self.port.close()
        self._error = error
        self._retry_at = time.monotonic() + self._backoff.next()
        for share in self._shares:
            self._withdraw(share)
        for number, _ in self._writes:
            self._done(number, "The port is gone.", kind="gone")
        self._writes.clear()
        self._changed = True

    def _on_port(self, event: int) -> None:
        try:
            if event & WRITE:
                self.port.write(b"")
                if not self.port.backlog:
                    self._epoll.modify(self.port.fd, READ)
            data = self.port.read()
        except PortError as error:
            self._lost_port(error)
            return
        if not data:
            return
        stamp = time.monotonic_ns()
        for client in tuple(self._clients.values()):
            try:
                waited = len(client.queue)
                client.put(data, self._frame_size)
                if len(client.queue) and not waited:
                    self._rewatch(client)
            except OSError:
                self._hung_up(client)
        if self._server is not None:
            self._server.add(stamp, data)
            if self._server.collected >= SERVER_BYTES:
                self._to_server()

    def _write(self, data: bytes) -> None:
        """Send to the device; PortError: it is gone."""
        before = self.port.backlog
        self.port.write(data)
        if self.port.backlog and not before:
            self._epoll.modify(self.port.fd, READ | WRITE)

    # ── clients ──────────────────────────────────────────────────────────────────────────────────────────────────────

    def _offer(self, share: Share) -> None:
        """Offer a share, unless it is offered already; ShareError: it cannot be offered."""
        if share.is_open:
            return
        share.open()
        if share.listener >= 0:
            self._watch(share.listener, READ, lambda _: self._accept(share))
        self._changed = True

    def _withdraw(self, share: Share) -> None:
        """Disconnect the clients of a share and end it."""
        for client in list(share.clients):
            self._left(client)
        if share.listener >= 0:
            self._forget(share.listener)
        share.close()

    def _accept(self, share: Share) -> None:
        client = share.accept()
        if client is not None:
            self._came(share, client)

    def _came(self, share: Share, client: Client) -> None:
        self._clients[client.fd] = client
        self._watch(client.fd, READ, lambda event: self._on_client(share, client, event))
        self._changed = True

    def _left(self, client: Client) -> None:
        """Forget a client."""
        if self._clients.pop(client.fd, None) is None:
            return
        self._forget(client.fd)
        self._paused.discard(client.fd)
        self.arbiter.forget(client.number)
        self._changed = True

    def _share_of(self, client: Client) -> Share | None:
        return next((share for share in self._shares if client in share.clients), None)

    def _drop(self, client: Client) -> None:
        """Disconnect a client."""
        share = self._share_of(client)
        self._left(client)
        if share is not None:
            with contextlib.suppress(ShareError):
                share.drop(client)

    def _hung_up(self, client: Client) -> None:
        share = self._share_of(client)
        if share is not None and share.address.kind == "pty":
            share.clients.remove(client)  # its terminal stays; `look` notices who opens it next
            self._left(client)
        else:
            self._drop(client)

    def _rewatch(self, client: Client) -> None:
        """Watch a client for what is expected of it now."""
        events = (0 if client.fd in self._paused else READ) | (WRITE if len(client.queue) else 0)
        with contextlib.suppress(OSError):
            self._epoll.modify(client.fd, events)

    def _on_client(self, share: Share, client: Client, event: int) -> None:
        try:
            if event & WRITE:
                client.flush()
                if not len(client.queue):
                    self._rewatch(client)
            if event & ~WRITE:
                self._read_client(client)
        except BlockingIOError:
            return
        except OSError:
            self._hung_up(client)

    def _read_client(self, client: Client) -> None:
        now = time.monotonic()
        if client.may_write and not (self.arbiter.may_speak(client.number, now) and self.port.backlog < MOST_WAITING):
            self._paused.add(client.fd)
            self._rewatch(client)
            self._changed = True
            return
        data = client.read()
        if not client.may_write or not self.port.is_open:
            client.refused += len(data)
            return
        had_voice = self.arbiter.speaker(now) == client.number
        self.arbiter.spoke(client.number, now)
        self._changed = self._changed or not had_voice
        try:
            self._write(data)
        except PortError as error:
            self._lost_port(error)
            return
        if self._server is not None:
            self._server.send(message(MessageKind.CLIENT_DATA, CLIENT.pack(time.monotonic_ns(), client.number) + data))

    def _speak_next(self, now: float) -> None:
        """Let those who wait for the voice speak, the server first."""
        if self._writes and self.arbiter.may_speak(SERVER, now):
            writes, self._writes = self._writes, []
            for number, data in writes:
                self._write_for_server(number, data, now)
        for fd in list(self._paused):
            client = self._clients[fd]
            if self.arbiter.may_speak(client.number, now) and self.port.backlog < MOST_WAITING:
                self._paused.discard(fd)
                self._rewatch(client)
                self._changed = True

    # ── the server ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _listen(self) -> None:
        path = self._settings.socket
        accepting = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        if os.path.exists(path):
            try:
                accepting.connect(path)
            except OSError:
                os.unlink(path)  # of a holder that was killed
            else:
                accepting.close()
                raise OSError(errno.EADDRINUSE, "another holder has this port")
            accepting.close()
            accepting = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        before = os.umask(0o177)
        try:
            accepting.bind(path)
        finally:
            os.umask(before)
        accepting.listen(1)
        accepting.setblocking(False)
        self._accepting = accepting
        self._watch(accepting.fileno(), READ, self._on_server_connects)

    def _on_server_connects(self, _: int) -> None:
        assert self._accepting is not None
        try:
            connection, _peer = self._accepting.accept()
        except OSError:
            return
        hello = {"version": VERSION, "pid": os.getpid(), "source": self._settings.source, "busy": 0}
        if self._server is not None:  # one that is gone has closed its end
            with contextlib.suppress(OSError):
                connection.sendall(json_message(MessageKind.HELLO, hello | {"busy": self._server.pid}))
            connection.close()
            return
        connection.setblocking(False)
        self._server = ServerConnection(connection)
        self._watch(connection.fileno(), READ, self._on_server)
        self._server.send(json_message(MessageKind.HELLO, hello))
        self._changed = True
        self._send_state(time.monotonic())

    def _on_server(self, event: int) -> None:
        server = self._server
        if server is None:
            return
        try:
            if event & WRITE:
                server.flush()
                self._epoll.modify(server.fd, READ | (WRITE if server.backlog else 0))
            if event & ~WRITE:
                for kind, body in server.read():
                    self._on_message(kind, body)
        except BlockingIOError:
            return
        except (OSError, MessageError, KeyError, ValueError):
            self._server_gone()

    def _server_gone(self) -> None:
        server, self._server = self._server, None
        if server is not None:
            self._forget(server.fd)
            server.close()
        self.arbiter.unlock()
        self._writes.clear()

    def _to_server(self) -> None:
        if self._server is not None:
            self._server.pass_on()
            if self._server.backlog > MOST_BEHIND:
                self._server_gone()
            elif self._server.backlog:
                self._epoll.modify(self._server.fd, READ | WRITE)

    def _send_state(self, now: float) -> None:
        self._changed = False
        self._state_at = now + STATE_S
        if self._server is not None:
            self._server.send(json_message(MessageKind.STATE, self.state(now)))
            if self._server.backlog:
                self._epoll.modify(self._server.fd, READ | WRITE)

    def state(self, now: float) -> dict[str, Any]:
        """The whole state."""
        error = self._error
        return {
            "open": self.port.is_open,
            "error": str(error) if error is not None else "",
            "errno": error.number if error is not None else 0,
            "baud": self.port.baud,
            "speaker": self.arbiter.speaker(now),
            "shares": [share.address.to_json() for share in self._shares],
            "clients": [{**client.state(), "paused": client.fd in self._paused} for client in self._clients.values()],
        }

    def _on_message(self, kind: MessageKind, body: bytes) -> None:
        if kind == MessageKind.WRITE:
            number = int.from_bytes(body[:4], "little")
            now = time.monotonic()
            if not self.port.is_open:
                self._done(number, "The port is gone.", kind="gone")
            elif self._writes or not self.arbiter.may_speak(SERVER, now):
                self._writes.append((number, body[4:]))
            else:
                self._write_for_server(number, body[4:], now)
        elif kind == MessageKind.REQUEST:
            request = json.loads(body)
            number = int(request["id"])
            try:
                carry_out(self, request)
            except (PortError, ShareError) as error:
                self._done(number, f"{error}", kind="refused")
                return
            self._changed = True
            self._done(number)

    def _write_for_server(self, number: int, data: bytes, now: float) -> None:
        self.arbiter.spoke(SERVER, now)
        try:
            self._write(data)
        except PortError as error:
            self._done(number, f"The port is gone: {error}.", kind="gone")
            self._lost_port(error)
            return
        self._done(number)

    def add_share(self, address: ShareAddress) -> None:
        """Offer a share from now on; ShareError: it cannot be offered."""
        share = make_share(address, self._next_number)
        if any(one.address.text == address.text for one in self._shares):
            raise ShareError(f"{address.text} is shared already")
        self._offer(share)
        self._shares.append(share)
        if not self.port.is_open:
            self._withdraw(share)

    def unshare(self, name: str) -> None:
        """End a share."""
        for share in [one for one in self._shares if one.address.text == name]:
            self._withdraw(share)
            self._shares.remove(share)

    def drop_client(self, number: int) -> None:
        """Disconnect a client."""
        for client in [one for one in self._clients.values() if one.number == number]:
            self._drop(client)

    def use_frames(self, module: str) -> None:
        """Find frames with a module that has `frame_size` (queues.FrameSize); "": not at all."""
        self._frame_size = import_module(module).frame_size if module else None

    def _done(self, number: int, error: str = "", *, kind: str = "") -> None:
        if self._server is not None:
            body = {"id": number, **({"error": error, "kind": kind} if error else {})}
            self._server.send(json_message(MessageKind.DONE, body))
            if self._server.backlog:
                self._epoll.modify(self._server.fd, READ | WRITE)

    def _close(self) -> None:
        for share in self._shares:
            share.close()
        self.port.close()
        self._server_gone()
        if self._accepting is not None:
            self._accepting.close()
            with contextlib.suppress(OSError):
                os.unlink(self._settings.socket)
        self._epoll.close()
