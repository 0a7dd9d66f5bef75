"""The shares of a port with their clients: who comes and leaves, what they get, what they send and when.

    port ──distribute──> clients
    clients ──read──> voice free? (arbiter) ── within the line's capacity? (sendable) ──> port, server

A client that may not send yet is not read; the data it wants to send stay in its own buffers, as with a port that is
busy. After MOST_WAIT_S it is taken from there and refused, since an answer that late would be taken for another.
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence

from imuscope.server.extensions.shares.holder.arbiter import Arbiter
from imuscope.server.extensions.shares.holder.client_frames import FrameRules
from imuscope.server.extensions.shares.holder.clients import Client, sendable
from imuscope.server.extensions.shares.holder.event_loop import GONE, READ, WRITE, EventLoop
from imuscope.server.extensions.shares.holder.port import MOST_WAITING, Port, PortError
from imuscope.server.extensions.shares.holder.share_kinds import Share, make_share
from imuscope.server.extensions.shares.holder.shares import ShareAddress, ShareError
from imuscope.server.system.light_modules import Any

MOST_WAIT_S = 10.0  # of a client for the voice
SETTLE_S = 0.02  # from a new rate of a client to that of the port: what it sent before goes out at the former one
MOST_SETTLE_S = 1.0
PAUSE_S = 0.1  # of a client whose frames are not known, after which a dialogue of it is probably over
LIMITED_S = 1.0  # for which a client counts as held back, since it was the last time
DISPLACED = 64  # clients that are remembered as having given way to others
LEAST_READ = 64  # bytes that a client may send before it is read again, so that a flood does not cost wake-ups


class Sharing:
    """All shares of one port.

    Args:
        write: sends to the device; it reports by itself that the port is gone.
        on_sent: called with what a client sent to the device.

    Attributes:
        displaced: numbers of the last clients that had to give way to others.
        turned_away: number of connections that were refused because all places were taken.
    """

    def __init__(
        self,
        addresses: Iterable[ShareAddress],
        loop: EventLoop,
        port: Port,
        arbiter: Arbiter,
        write: Callable[[bytes], None],
        on_sent: Callable[[Client, bytes], None],
    ) -> None:
        self._loop, self._port, self._arbiter = loop, port, arbiter
        self._write, self._on_sent = write, on_sent
        self.shares: list[Share] = [make_share(one, self._next_number) for one in addresses]
        self.clients: dict[int, Client] = {}  # by descriptor
        self._held_back: set[int] = set()  # descriptors of clients that are not read now
        self._numbers = 0
        self.displaced: deque[int] = deque(maxlen=DISPLACED)
        self.unsent: deque[dict[str, Any]] = deque(maxlen=20)  # of programs that left: bytes that were not passed on
        self.turned_away = 0
        self.rules = FrameRules()
        self.changed = True
        self.server_waits = False
        """The server has something to send, or a transaction to begin."""

    def _next_number(self) -> int:
        self._numbers += 1
        return self._numbers

    @property
    def is_calm(self) -> bool:
        """Whether no client waits for anything."""
        return not self._held_back and all(one.wanted_baud is None for one in self.clients.values())

    def state(self, now: float) -> list[dict[str, Any]]:
        """The clients, for the server."""
        return [client.state(now) for client in self.clients.values()]

    # ── shares ───────────────────────────────────────────────────────────────────────────────────────────────────────

    def offer(self, share: Share) -> None:
        """Offer a share, unless it is offered already; ShareError: it cannot be offered."""
        if share.is_open:
            return
        share.open()
        if share.listener >= 0:
            self._loop.watch(share.listener, READ, lambda _: self._accept(share))
        self.changed = True

    def offer_all(self) -> None:
        """Offer every share again, after the port was gone; one that cannot be offered now is tried the next time."""
        for share in self.shares:
            with contextlib.suppress(ShareError):  # it could be offered before
                self.offer(share)

    def withdraw(self, share: Share) -> None:
        """Disconnect the clients of a share and end it."""
        for client in list(share.clients):
            self._left(client)
        if share.listener >= 0:
            self._loop.forget(share.listener)
        share.close()
        self.changed = True

    def withdraw_all(self) -> None:
        """Withdraw every share: what a client sees when an adapter is unplugged."""
        for share in self.shares:
            self.withdraw(share)

    def add(self, address: ShareAddress) -> None:
        """Offer a share from now on; ShareError: it cannot be offered."""
        share = make_share(address, self._next_number)
        if any(one.address.text == address.text for one in self.shares):
            raise ShareError(f"{address.text} is shared already")
        self.offer(share)
        self.shares.append(share)
        if not self._port.is_open:
            self.withdraw(share)

    def remove(self, name: str) -> None:
        for share in [one for one in self.shares if one.address.text == name]:
            self.withdraw(share)
            self.shares.remove(share)

    # ── clients come and leave ───────────────────────────────────────────────────────────────────────────────────────

    def update(self, now: float) -> None:
        """Find who opened or closed a terminal, or set its rate; let those speak who waited. Called at every tick."""
        for share in self.shares:
            came, left = share.update()
            for client in share.clients:
                self._follow_rate(client, now)
            if left is not None:
                self._left_terminal(share, left)
            if came is not None:
                self._came(share, came)
        self._take_turn(now)
        for fd in list(self._held_back):
            self._try_again(self.clients[fd], now)

    def _read_last(self, client: Client) -> None:
        """Pass on what a program wrote right before it closed its terminal; count what the device is not free for."""
        unsent = 0
        with contextlib.suppress(OSError):
            while data := client.read():
                now = time.monotonic()
                if client.may_write and self._port.is_open and self._may_speak(client, now):
                    self._pass_on(client, data, now)
                else:
                    unsent += len(data)
        if unsent:
            self.unsent.append({"peer": client.peer, "number": client.number, "bytes": unsent})

    def _take_turn(self, now: float) -> None:
        """Let others have the voice of a client that never pauses (polling, odometry), at a place between two frames.

        One that configures the device keeps it until it is done.
        """
        speaker = self._arbiter.speaker(now)
        client = next((one for one in self.clients.values() if one.number == speaker), None)
        if client is None or self._arbiter.configuring(now) is not None or not self._is_awaited(client):
            return
        is_between = self._arbiter.pause_s(now) >= PAUSE_S or (self.rules.size is not None and client.frames.is_between)
        if is_between and self._arbiter.take_turn(client.number, now):
            self.changed = True

    def _accept(self, share: Share) -> None:
        if share.is_full:
            idle = share.idle_client()
            if idle is None:
                share.turn_away()
                self.turned_away += 1
                self.changed = True
                return
            self.displaced.append(idle.number)
            self._drop(idle)
        client = share.accept()
        if client is not None:
            self._came(share, client)

    def _came(self, share: Share, client: Client) -> None:
        self.clients[client.fd] = client
        self._loop.watch(client.fd, READ, lambda event: self._on_ready(share, client, event))
        self.changed = True

    def _left(self, client: Client) -> None:
        if self.clients.get(client.fd) is not client:
            return
        del self.clients[client.fd]
        self._loop.forget(client.fd)
        self._held_back.discard(client.fd)
        self._arbiter.forget(client.number)
        self.changed = True

    def drop(self, number: int) -> None:
        """Disconnect a client."""
        for client in [one for one in self.clients.values() if one.number == number]:
            self._drop(client)

    def _drop(self, client: Client) -> None:
        share = self._share_of(client)
        self._left(client)
        if share is not None:
            with contextlib.suppress(ShareError):
                share.drop(client)

    def _share_of(self, client: Client) -> Share | None:
        return next((share for share in self.shares if client in share.clients), None)

    def _hung_up(self, client: Client) -> None:
        share = self._share_of(client)
        if share is not None and share.address.kind == "pty":
            share.clients.remove(client)  # its terminal stays; `update` notices who opens it next
            self._left_terminal(share, client)
        else:
            self._read_last(client)
            self._drop(client)

    def _left_terminal(self, share: Share, client: Client) -> None:
        """Forget the client of a terminal, with what it has not read. A program that has opened it again since reads on
        where the last one ended: it would miss what comes until the next look.
        """
        self._read_last(client)
        self._left(client)
        came, _ = share.update()
        if came is None:
            share.clean()
            came, _ = share.update()  # as it may have been opened before that
        if came is not None:
            self._came(share, came)

    def _follow_rate(self, client: Client, now: float) -> None:
        """Set the port to the rate that a client set after it has sent to the device; before, the rate has no meaning.

        What it sent before goes out at the former rate: the port follows when that has left.
        """
        before, client.last_baud = client.last_baud, client.baud
        talks = client.received or client.paused_since
        if client.may_write and talks and client.baud is not None and before is not None and client.baud != before:
            client.wanted_baud, client.wanted_since = client.baud, now
        if client.wanted_baud is None or client.paused_since or now - client.wanted_since < SETTLE_S:
            return
        if self._port.has_sent_all() or now - client.wanted_since > MOST_SETTLE_S:
            baud, client.wanted_baud = client.wanted_baud, None
            if baud != self._port.baud:
                try:
                    self._port.set_baud(baud)
                except PortError:
                    client.refused_baud = baud
                self.changed = True

    # ── to clients ───────────────────────────────────────────────────────────────────────────────────────────────────

    def distribute(self, data: bytes) -> None:
        """Send bytes of the device to every client."""
        gone = []
        for client in self.clients.values():
            try:
                if client.put(data, self.rules.size):
                    self._expect(client)
            except OSError:
                gone.append(client)
        for client in gone:
            self._hung_up(client)

    def put_rest(self, clients: Sequence[Client], data: bytes, counts: Sequence[int]) -> None:
        """Let the rest of a read wait for the clients that have taken less of it; −1: nothing, by an error."""
        for client, count in zip(clients, counts, strict=True):
            if count < len(data):
                try:
                    if client.put(data[max(count, 0) :], self.rules.size):
                        self._expect(client)
                except OSError:
                    self._hung_up(client)

    # ── from clients ─────────────────────────────────────────────────────────────────────────────────────────────────

    def _expect(self, client: Client) -> None:
        """Watch a client for the events expected of it now."""
        events = (0 if client.fd in self._held_back else READ) | (WRITE if client.queue.size else 0)
        self._loop.expect(client.fd, events)

    def _on_ready(self, share: Share, client: Client, event: int) -> None:
        try:
            if event & WRITE:
                client.flush()
                if not client.queue.size:
                    self._expect(client)
            if client.fd in self._held_back and event & GONE:
                raise OSError
            if event & ~WRITE:
                self._read(client)
        except BlockingIOError:
            return
        except OSError:
            self._hung_up(client)

    def _read(self, client: Client) -> None:
        """Read a client that has something to send; OSError as Client.read."""
        now = time.monotonic()
        is_refused = not client.may_write or not self._port.is_open
        if not is_refused and not self._may_speak(client, now):
            self._hold_back(client, now, paused=True)
            return
        most = sendable(client.budget, now, self._port.capacity)
        if most < LEAST_READ:
            self._hold_back(client, now, paused=False)
            if self._is_awaited(client) and self._arbiter.take_turn(client.number, now):
                self.changed = True
            return
        data = client.read(most)
        client.budget.acquire(now, len(data))
        if is_refused:
            client.refused += len(data)
            return
        self._pass_on(client, data, now)

    def _pass_on(self, client: Client, data: bytes, now: float) -> None:
        had_voice = self._arbiter.speaker(now) == client.number
        self._arbiter.spoke(client.number, now)
        self._recognise(client, data, now)
        self.changed = self.changed or not had_voice
        self._write(data)
        self._on_sent(client, data)

    def _recognise(self, client: Client, data: bytes, now: float) -> None:
        """Note frames that configure the device."""
        before = self._arbiter.configuring(now)
        for effect in client.frames.feed(data, self.rules):
            if effect == "end":
                self._arbiter.configured(client.number, now)
            else:
                self._arbiter.configures(client.number, now, until_done=effect == "begin")
        self.changed = self.changed or self._arbiter.configuring(now) != before

    def _may_speak(self, client: Client, now: float) -> bool:
        return self._arbiter.may_speak(client.number, now) and self._port.backlog < MOST_WAITING

    def _is_awaited(self, client: Client) -> bool:
        """Whether another client waits for the voice of a client."""
        return self.server_waits or any(
            one.paused_since for one in self.clients.values() if one.number != client.number
        )

    def _hold_back(self, client: Client, now: float, *, paused: bool) -> None:
        """Stop reading a client for now: it waits for the voice (`paused`), or sends more than the line carries."""
        if paused and not client.paused_since:
            client.paused_since = now
            self.changed = True
        if not paused:
            client.limited_until = now + LIMITED_S
        client.held_since = now
        self._held_back.add(client.fd)
        self._expect(client)

    def _try_again(self, client: Client, now: float) -> None:
        """Read a client again that was held back, if it may send now; refuse what it has waited too long for."""
        if client.paused_since and not self._may_speak(client, now):
            if now - client.paused_since > MOST_WAIT_S:
                with contextlib.suppress(OSError):  # clients that left are found when the device sends
                    client.refused += len(client.read())
            return
        if client.paused_since:
            client.paused_since, self.changed = 0.0, True
        else:
            client.limited_s += now - client.held_since
        self._held_back.discard(client.fd)
        self._expect(client)
