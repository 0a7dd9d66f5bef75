"""The loop of the holder.

    port ──read, stamp──┬── clients: at once                 the robot's driver comes first
                        └── server: at most every SERVER_NS  its samples carry the stamp
           as machine code while every client keeps up (`Relay`); else, and all the rest, here

A port that is gone is opened as soon as it is back: its path is looked at with every tick. Until then its terminals and
TCP ports are closed: a client sees what an unplugged adapter would show. Started by a server, the holder ends when
neither a server nor a client has been there for GRACE_S; with `stay`, only by a signal.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader

from imuscope.server.concurrency.backoff import LOCAL_S, Backoff
from imuscope.server.extensions.shares.holder.arbiter import SERVER, Arbiter
from imuscope.server.extensions.shares.holder.client_frames import FrameRules
from imuscope.server.extensions.shares.holder.clients import Client, UdpClient
from imuscope.server.extensions.shares.holder.event_loop import ONCE, READ, RELAYED, WRITE, EventLoop
from imuscope.server.extensions.shares.holder.messages import MessageKind
from imuscope.server.extensions.shares.holder.port import Port, PortError
from imuscope.server.extensions.shares.holder.server_connection import ServerConnection
from imuscope.server.extensions.shares.holder.server_session import ServerSide
from imuscope.server.extensions.shares.holder.settings import HolderSettings
from imuscope.server.extensions.shares.holder.shares import ShareAddress, ShareError
from imuscope.server.extensions.shares.holder.sharing import Sharing
from imuscope.server.extensions.shares.holder.socket_paths import port_link
from imuscope.server.system.light_modules import INFINITY, Any
from imuscope.server.system.terminals import standing_at

MOST_CLIENTS = 4
TIME_IS_OVER, OTHERS, PORT_FAILED, LEFT_OVER = 0, 1, -1, 2
SECOND_NS = 1e9


class Relay:
    """The loop of a shared port as machine code: loaded without numpy, and called with what the holder has.

    It takes the place of the holder's own loop while every client keeps up; one that does not is served by Python until
    its queue is empty. `server/extensions/shares/relay_kernel.py` is the function, and its documentation.

    Args:
        path, name: of the library and of the function in it (relay_kernel.place).

    Raises:
        ImportError, AttributeError: it cannot be loaded.
    """

    def __init__(self, path: str, name: str) -> None:
        spec = spec_from_loader("imuscope_native.kernels", ExtensionFileLoader("imuscope_native.kernels", path))
        assert spec is not None
        assert spec.loader is not None
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        self._function: Any = getattr(module, name)
        self._left_over, self._spill = os.pipe()

    @staticmethod
    def serves(port: Port, clients: Sequence[Client], server: ServerConnection | None) -> bool:
        """Whether it can pass on now: nothing waits anywhere."""
        return (
            port.is_open
            and not port.backlog
            and len(clients) <= MOST_CLIENTS
            and all(type(one) is not UdpClient and not one.queue.size for one in clients)
            and (server is None or not server.backlog)
        )

    def run(
        self, port: Port, epoll: int, clients: Sequence[Client], server: ServerConnection | None, until: float
    ) -> tuple[int, bytes, Sequence[int]]:
        """Pass on bytes of the device until a time, monotonic, s.

        Returns:
            state, and the last read with what each client has taken of it if one has not taken it all.
        """
        descriptors = [*(one.fd for one in clients), *(-1,) * (MOST_CLIENTS - len(clients))]
        state, total, size, *rest = self._function(
            port.fd,
            epoll,
            tuple(descriptors),
            -1 if server is None else server.fd,
            self._spill,
            int(until * SECOND_NS),
        )
        counts, unsent = rest[: len(clients)], rest[MOST_CLIENTS]
        last = b""
        for client, count in zip(clients, counts, strict=True):
            client.sent += total - size + max(count, 0)
            if count < size:
                last = last or os.read(self._left_over, size)
        if unsent and server is not None:
            server.keep(os.read(self._left_over, unsent))
        return state, last, counts

    def close(self) -> None:
        os.close(self._left_over)
        os.close(self._spill)


TICK_S = 0.02
CALM_S = 0.05  # between two ticks while no client talks to the device or waits: one costs as much as ten frames
LATE_S = 0.005  # after which a tick has a wake-up of its own: bytes that arrive until then take it along
STATE_S = 1.0
GRACE_S = 10.0
FIRST_RETRY_S, LAST_RETRY_S = 0.5, 10.0


class Holder:
    """One port and everybody at it."""

    def __init__(self, settings: HolderSettings) -> None:
        self._settings = settings
        self.port = Port(settings.source)
        self.arbiter = Arbiter()
        self._loop = EventLoop()
        self.sharing = Sharing(settings.shares, self._loop, self.port, self.arbiter, self._write, self._on_client_sent)
        self.server = ServerSide(
            settings.socket,
            {"source": settings.source},
            self._loop,
            on_message=self._on_message,
            on_gone=self._on_server_gone,
            state=lambda: self.state(time.monotonic()),
        )
        self._path = str(settings.source.get("place", ""))
        self._backoff = Backoff(*(LOCAL_S if self._path else (FIRST_RETRY_S, LAST_RETRY_S)))
        self._path_identity: tuple[int, ...] | None = None  # at the path, when the port failed
        self._error: PortError | None = None
        self._retry_at = 0.0
        self._state_at = 0.0
        self._speaker: int | None = None  # in the last state
        self._last_company = time.monotonic()
        self._ended = False
        self._relay: Relay | None = None
        self._relays = False  # the port is read by machine code
        if settings.kernel:
            with contextlib.suppress(ImportError, AttributeError):  # it was replaced by an update
                self._relay = Relay(*settings.kernel)

    # ── the loop ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def run(self, ready: Callable[[], None], failed: Callable[[Exception], None]) -> None:
        """Hold the port until a signal, or until no process needs it.

        Args:
            ready: called when a server can connect and all shares are offered.
            failed: called with a defect of this program after that, while everybody is still connected.

        Raises:
            OSError: its socket cannot be created.
            ShareError: another holder has the port, or a share cannot be offered.
        """
        self.server.listen(self._port_link())
        try:
            for share in self.sharing.shares:
                self.sharing.offer(share)  # also if the port is not there: the problem is reported at once
            self._open_port()
            if not self.port.is_open:
                self.sharing.withdraw_all()
            ready()
            try:
                self._serve()
            except Exception as error:  # top of the process: it ends, and reports why
                failed(error)
        finally:
            self._close()

    def _serve(self) -> None:
        run_once, clock = self._loop.run_once, time.monotonic
        next_tick = clock() + TICK_S
        while not self._ended:
            now = clock()
            if now >= next_tick:
                self._tick(now)
                is_calm = self.port.is_open and self.sharing.is_calm and self.arbiter.speaker(now) is None
                next_tick = now + (CALM_S if is_calm else TICK_S)
            due_at = self.server.connection.due_at if self.server.connection is not None else INFINITY
            if due_at <= now:
                self.server.pass_on()
            elif due_at == INFINITY and self._relayed(next_tick + LATE_S):
                continue
            else:
                run_once(min(next_tick + LATE_S, due_at) - now)

    def _relayed(self, until: float) -> bool:
        """Pass on bytes by machine code until a time, or until there is more to do; False where that cannot be."""
        relay, port, server = self._relay, self.port, self.server.connection
        if relay is None:
            return False
        clients = list(self.sharing.clients.values())
        serves = relay.serves(port, clients, server)
        if not serves:
            if self._relays:
                self._expect_port(READ | (WRITE if port.backlog else 0))
            return False
        self._expect_port(RELAYED | (ONCE if port.is_serial else 0))  # each time: reports bytes that are there already
        state, last, counts = relay.run(port, self._loop.fd, clients, server, until)
        if last:
            self.sharing.put_rest(clients, last, counts)
        if server is not None and server.backlog:
            self.server.pass_on()
        if state == PORT_FAILED:
            self._on_port(READ)
        elif state == OTHERS:
            self._expect_port(READ)  # also its end may have been reported, once: before a server gets the state
            self._loop.run_once(0, self.port.fd)
        return True

    def end(self, *_: Any) -> None:
        """End the loop; a signal handler."""
        self._ended = True

    def _tick(self, now: float) -> None:
        self.sharing.server_waits = bool(self.server.writes) or self.arbiter.is_locked
        self.sharing.update(now)
        if not self.port.is_open and (self._has_returned() or now >= self._retry_at):
            self._open_port()
        if self.server.writes and self.arbiter.may_speak(SERVER, now):
            writes, self.server.writes = self.server.writes, []
            for one in writes:
                self._write_for_server(one.number, one.data, now)
        self.server.refuse_late(now)
        if self.sharing.changed or now >= self._state_at or self.arbiter.speaker(now) != self._speaker:
            self.sharing.changed = False
            self._state_at = now + STATE_S
            self.server.send_state()
        if self.server.connection is not None or self.sharing.clients or self._settings.stay:
            self._last_company = now
        elif now - self._last_company > GRACE_S:
            self._ended = True

    # ── the port ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def _has_returned(self) -> bool:
        """Whether something stands at the path of the port that did not at the last look."""
        before, self._path_identity = self._path_identity, standing_at(self._path)
        if self._path_identity in (None, before):
            return False
        self._backoff.reset()
        return True

    def _open_port(self) -> None:
        self.sharing.changed = True
        try:
            self.port.open()
        except PortError as error:
            self._closed(error)
            return
        self._error = None
        self._backoff.reset()
        self._loop.watch(self.port.fd, READ, self._on_port)
        self._relays = False
        self.server.name(self._port_link())
        self.sharing.offer_all()

    def _port_link(self) -> str:
        return port_link(self._path, self._settings.socket)

    def _lost_port(self, error: PortError) -> None:
        self._loop.forget(self.port.fd)
        self.port.close()
        self.server.name("")  # another device may get its number
        self._closed(error)
        self.sharing.withdraw_all()
        self.server.refuse_all("the port is gone", kind="gone")

    def _closed(self, error: PortError) -> None:
        self._error = error
        self._path_identity = standing_at(self._path)
        self._retry_at = time.monotonic() + self._backoff.next()

    def _on_port(self, event: int) -> None:
        try:
            if event & WRITE:
                self.port.write(b"")
                if not self.port.backlog:
                    self._expect_port(READ)
                if not event & ~WRITE:  # an empty read would count as a sign that the port is gone
                    return
            data = self.port.read()
        except PortError as error:
            self._lost_port(error)
            return
        if not data:
            return
        stamp = time.monotonic_ns()
        self.sharing.distribute(data)
        server = self.server.connection
        if server is not None and server.add(stamp, data):
            self.server.pass_on()

    def _write(self, data: bytes) -> None:
        try:
            self._send(data)
        except PortError as error:
            self._lost_port(error)

    def _send(self, data: bytes) -> None:
        before = self.port.backlog
        self.port.write(data)
        if self.port.backlog and not before:
            self._expect_port(READ | WRITE)

    def _expect_port(self, events: int) -> None:
        self._relays = events & RELAYED == RELAYED
        self._loop.expect(self.port.fd, events)

    def _on_client_sent(self, client: Client, data: bytes) -> None:
        self.server.on_client_data(time.monotonic_ns(), client, data)

    # ── the server ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _on_server_gone(self) -> None:
        self._last_company = time.monotonic()  # one that waits for the port comes and goes
        self.arbiter.unlock()

    def state(self, now: float) -> dict[str, Any]:
        """The whole state."""
        error = self._error
        self._speaker = self.arbiter.speaker(now)
        return {
            "open": self.port.is_open,
            "error": str(error) if error is not None else "",
            "errno": error.number if error is not None else 0,
            "baud": self.port.baud,
            "speaker": self._speaker,
            "configuring": self.arbiter.configuring(now),
            "shares": [share.address.to_json() for share in self.sharing.shares],
            "clients": self.sharing.state(now),
            "displaced": list(self.sharing.displaced),
            "unsent": list(self.sharing.unsent),
            "turned_away": self.sharing.turned_away,
        }

    def _on_message(self, kind: MessageKind, body: bytes) -> None:
        if kind == MessageKind.WRITE:
            number = int.from_bytes(body[:4], "little")
            now = time.monotonic()
            if self.port.is_open and (self.server.writes or not self.arbiter.may_speak(SERVER, now)):
                self.server.wait(number, body[4:], now)
            else:
                self._write_for_server(number, body[4:], now)
        elif kind == MessageKind.REQUEST:
            request = json.loads(body)
            number = int(request["id"])
            try:
                self._carry_out(request)
            except (PortError, ShareError) as error:
                self.server.done(number, f"{error}", kind="refused")
                return
            self.sharing.changed = True
            self.server.done(number)

    def _write_for_server(self, number: int, data: bytes, now: float) -> None:
        if not self.port.is_open:  # lost with the write before, too
            self.server.done(number, "the port is gone", kind="gone")
            return
        self.arbiter.spoke(SERVER, now)
        stamp = time.monotonic_ns()  # before: an answer must not seem older than its request
        try:
            self._send(data)
        except PortError as error:
            self.server.done(number, f"the port is gone: {error}", kind="gone")
            self._lost_port(error)
            return
        self.server.done(number, stamp_ns=stamp)

    def _carry_out(self, request: Mapping[str, Any]) -> None:
        """Carry out one request of the server.

        {"do": "lock"} · "unlock"        begin and end a transaction, in which clients wait
        {"do": "baud", "baud": N}        change the rate of the port · "try": and back, to see whether it has that rate
        {"do": "share", "share": {…}}    offer a share · "unshare", "name": end it · "drop", "number": end a client
        {"do": "frames", "module": "…"}  how frames are found, with "configuration": which of them configure the device
        {"do": "take-over", "number": N} end the configuration that a client has not finished
        {"do": "end"}                    end the holder

        Raises:
            PortError, ShareError: it cannot be carried out.
            KeyError: it is not one of these.
        """
        match request["do"]:
            case "lock":
                self.arbiter.lock()
            case "unlock":
                self.arbiter.unlock()
            case "baud":
                self.port.set_baud(int(request["baud"]))
            case "try":
                self.port.try_baud(int(request["baud"]))
            case "share":
                self.sharing.add(ShareAddress.from_json(request["share"]))
            case "unshare":
                self.sharing.remove(request["name"])
            case "drop":
                self.sharing.drop(int(request["number"]))
            case "take-over":
                self.arbiter.forget(int(request["number"]))
            case "frames":
                self.sharing.rules = FrameRules.of(request["module"], request.get("configuration", ""))
            case "end":
                self.end()
            case other:
                raise KeyError(other)

    def _close(self) -> None:
        self.sharing.withdraw_all()
        self.port.close()
        self.server.close()
        self._loop.close()
        if self._relay is not None:
            self._relay.close()
