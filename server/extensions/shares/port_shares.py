"""Shares of the ports of devices: which there are, who is at them, and what their clients send.

    session ── SharedPortLink ── holder ──┬── clients
       ^           │                 └── port
       └───────────┴── events, traffic log and recording of what clients send

A device whose port is not shared yet keeps its session: only its link is replaced.
"""

import asyncio
import os
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary

from imuscope.server.configuration.controllers import ControllerRegistry
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.devices.link.session import Session
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.errors import DomainError
from imuscope.server.extensions.shares.client_changes import ClientChanges, SettingsChange
from imuscope.server.extensions.shares.holder.arbiter import SERVER
from imuscope.server.extensions.shares.holder.shares import ShareAddress, ShareError
from imuscope.server.extensions.shares.holder.socket_paths import runtime_folder
from imuscope.server.extensions.shares.settings import ShareSettings
from imuscope.server.extensions.shares.shared_port_link import ClientData, SharedPortLink, is_held
from imuscope.server.links.base import Link, LinkError
from imuscope.server.links.serial import SerialLink
from imuscope.server.links.tcp import TcpLink
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.system.open_files import programs_with

MOST_SHARES = 8
POLL_S = 0.02
MOST_PARTIAL = 4096  # bytes of a client without a frame, after which they are logged as they are
PORTS = "A serial port or a TCP connection can be shared."


def parts(services: Services) -> Iterator[ServicePart]:
    """The shares of all ports."""
    addresses = services.config.of(ShareSettings).shares
    yield ServicePart(
        "shared ports",
        PortShares(services.telemetry.bus, services.sessions, services.controllers, addresses),
    )


class PortShares:
    """The shares of all devices.

    Args:
        addresses: addresses by source, offered from the start; checked already (settings.py).
    """

    def __init__(
        self,
        bus: TelemetryBus,
        sessions: Sessions,
        controllers: ControllerRegistry,
        addresses: Mapping[str, Sequence[str]],
    ) -> None:
        self._bus = bus
        self._controllers = controllers
        self._configured = {source: [ShareAddress.parse(text) for text in texts] for source, texts in addresses.items()}
        self._partial: dict[tuple[str, int], bytes] = {}  # of a frame of a client, by device and client
        self._changes: dict[str, ClientChanges] = {}  # by device
        self._following: dict[str, list[Callable[[], None]]] = {}  # device → remove the listeners of its shared port
        self._tasks: set[asyncio.Task[None]] = set()
        self._turns: WeakKeyDictionary[Session, asyncio.Lock] = WeakKeyDictionary()  # requests about its port
        sessions.on_added(self._on_added)
        sessions.open_through(self._shared)

    def _shared(self, link: Link) -> Link:
        """The link of a source that is shared from the start, or whose port a holder has already (`imuscope hold`, or
        left by an earlier server), in place of the one that would open the port itself.

        Raises:
            LinkError: "bad-source": this kind of link cannot be shared.
        """
        shares = self._configured.get(link.source, [])
        if not shares and not (isinstance(link, SerialLink | TcpLink) and is_held(link)):
            return link
        if not isinstance(link, SerialLink | TcpLink):
            raise LinkError("bad-source", f"{link.source} has no port that can be shared.", PORTS)
        return SharedPortLink(link, shares, link.settings)

    def _on_added(self, session: Session) -> None:
        if isinstance(session.access.link, SharedPortLink):
            self._follow(session, session.access.link)

    def _follow(self, session: Session, link: SharedPortLink) -> None:
        known: dict[str, Any] = {"clients": {}, "arriving": {}, "configuring": None, "turned_away": 0, "unsent": 0}
        device = session.info.id

        async def closing() -> None:
            self._unfollow(device)
            changes = self._changes.pop(device, None)
            if changes is not None:
                changes.close()

        self._following[device] = [
            link.on_state.add(lambda state: self._on_state(session, link, known, state)),
            link.on_client_data.add(lambda data: self._on_client_data(session, link, data)),
            session.listeners.before_close(closing),
        ]

    def _unfollow(self, device: str) -> None:
        """Keep nothing of a port that is shared no longer: a device may be shared again and again."""
        for off in self._following.pop(device, ()):
            off()
        self._partial = {key: rest for key, rest in self._partial.items() if key[0] != device}

    # ── what clients do ──────────────────────────────────────────────────────────────────────────────────────────────

    def _on_state(
        self, session: Session, link: SharedPortLink, known: dict[str, Any], state: Mapping[str, Any]
    ) -> None:
        """Report clients that came, left or lost bytes, who configures the device, and a rate that a client set."""
        before, now = known["clients"], {one["number"]: one for one in state["clients"]}
        for number, one in now.items():
            if number not in before:
                known["arriving"][number] = self._start(self._report_new(session, link, one))
                continue
            for text in _news(link.name_of(number), before[number], one):
                self._report(session, "warning", text)
        for one in state.get("unsent", ()):
            if one["number"] <= known["unsent"]:
                continue
            known["unsent"] = one["number"]
            name = link.name_of(one["number"]) or one["peer"]
            words = f"{name} left before {one['bytes']} B that it had sent could be passed on: another was talking."
            self._report(session, "warning", words)
        for number in set(before) - set(now):
            is_displaced = number in state.get("displaced", ())
            arriving = known["arriving"].pop(number)
            self._start(self._report_gone(session, link, before[number], arriving, is_displaced=is_displaced))
            self._partial.pop((session.info.id, number), None)
        if state.get("turned_away", 0) > known["turned_away"]:
            self._report(session, "warning", "A client of the shared port was refused: all places are taken.")
        known["turned_away"] = state.get("turned_away", 0)
        configuring, known["clients"], known["configuring"] = known["configuring"], now, state.get("configuring")
        if state.get("configuring") != configuring:
            self._on_configuring(session, link, state.get("configuring"))
        if state["open"] and state["baud"] and state["baud"] != session.info.baud and session.info.baud:
            session.devices.own.state.set(baud=state["baud"])
            by = next((link.name_of(one["number"]) for one in now.values() if one["baud"] == state["baud"]), "A client")
            self._report(session, "warning", f"{by} set the port to {state['baud']} Bd.")

    async def _report_new(self, session: Session, link: SharedPortLink, client: Mapping[str, Any]) -> None:
        """Report a client by the name of its program, if that can be found."""
        if client.get("terminal"):
            programs = await asyncio.to_thread(programs_with, client["terminal"])
            others = [str(one) for one in programs if one.pid not in (link.holder_pid, os.getpid())]
            if others:
                link.names[client["number"]] = ", ".join(others)
        rights = "may write" if client["may_write"] else "only reads"
        name = link.names.get(client["number"]) or client["peer"]  # it may have left already
        self._report(session, "info", f"{name} is connected to the shared port and {rights}.")

    async def _report_gone(
        self,
        session: Session,
        link: SharedPortLink,
        client: Mapping[str, Any],
        arriving: asyncio.Task[None],
        *,
        is_displaced: bool,
    ) -> None:
        """Report that a client has left, after the report that it came."""
        await asyncio.wait((arriving,))
        name = link.names.pop(client["number"], "") or client["peer"]  # the link does not know it any more
        if is_displaced:
            words = "had to leave the shared port: all places were taken, and it sent and read nothing."
            self._report(session, "warning", f"{name} {words}")
            return
        lost = f" It lost {client['dropped_bytes']} B that it did not read in time." if client["dropped_bytes"] else ""
        self._report(session, "info", f"{name} left the shared port.{lost}")

    def _on_configuring(self, session: Session, link: SharedPortLink, client: int | None) -> None:
        if client is not None:
            text = f"{link.name_of(client)} is configuring the device; imuscope waits with what it sends."
            self._report(session, "info", text)
        elif session.info.id in self._changes:
            self._changes[session.info.id].finished()

    def _report(self, session: Session, level: Any, text: str) -> None:
        self._bus.event(session.info.id, "link", level, text, data={"kind": "share"})

    def _start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work, name="client of a share")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _on_client_data(self, session: Session, link: SharedPortLink, sent: ClientData) -> None:
        session.listeners.sent.call(sent.data, sent.arrival_ns)
        device = session.info.id
        try:
            controller = self._controllers.get(device)
        except KeyError:
            return
        if device not in self._changes:
            self._changes[device] = ClientChanges(controller, self._controllers.snapshots)
        changes, name = self._changes[device], link.name_of(sent.client) or sent.peer
        key = device, sent.client
        data = self._partial.pop(key, b"") + sent.data
        rest = log_frames(controller, name, data, sent.arrival_ns / 1e9, lambda line: changes.sent(name, line))
        if rest:
            self._partial[key] = rest

    def changes_of(self, session: Session) -> Sequence[SettingsChange]:
        """The last changes by clients, newest first."""
        changes = self._changes.get(session.info.id)
        return tuple(changes.latest) if changes is not None else ()

    @property
    def folder(self) -> str:
        """Folder in which the page may create terminals; "" if there is none."""
        try:
            return str(runtime_folder())
        except OSError:
            return ""

    # ── for routes ───────────────────────────────────────────────────────────────────────────────────────────────────

    def state(self, session: Session) -> tuple[Mapping[str, Any], Sequence[ShareAddress], str]:
        """State of the holder ({} without one), the shares, and why the port cannot be shared ("" if it can)."""
        link = session.access.link
        if isinstance(link, SharedPortLink):
            shares = [ShareAddress.from_json(one) for one in link.state.get("shares", ())]
            return link.state, shares or link.shares, ""
        if isinstance(link, SerialLink | TcpLink):
            return {}, (), ""
        return {}, (), f"{session.info.source} has no port that can be shared. {PORTS}"

    async def add(self, session: Session, text: str) -> None:
        """Share the port of a device.

        Raises:
            DomainError: the address is invalid, or cannot be offered.
            LinkError: the device was removed.
        """
        async with self._turn(session):
            await self._add(session, text)

    def _turn(self, session: Session) -> asyncio.Lock:
        """Held while shares of a port are added or removed: the link may be another one afterwards."""
        return self._turns.setdefault(session, asyncio.Lock())

    async def _add(self, session: Session, text: str) -> None:
        _, shares, why = self.state(session)
        if why:
            raise DomainError("not-now", why, "Choose another device.")
        try:
            address = ShareAddress.parse(text)
        except ShareError as error:
            raise DomainError("bad-value", f"{_sentence(error)}.", "A share is a path, tcp:// or udp://.") from None
        if len(shares) >= MOST_SHARES:
            raise DomainError("full", f"A port has at most {MOST_SHARES} shares.", "End one first.")
        if address.kind == "pty":
            await asyncio.to_thread(_check_path, address)
        link = session.access.link
        if isinstance(link, SharedPortLink):
            await link.request("share", share=address.to_json())
            link.shares.append(address)
            return
        assert isinstance(link, SerialLink | TcpLink)
        held = SharedPortLink(link, [address], link.settings)
        self._follow(session, held)
        try:
            await session.access.use_link(held)
            await _opened(session, held)
        except DomainError:
            self._unfollow(session.info.id)
            if not session.is_closed:
                await session.access.use_link(link)
            raise

    async def remove(self, session: Session, name: str) -> None:
        """End a share and disconnect its clients. The last one gives the port back to this server.

        Raises:
            DomainError: there is no such share.
        """
        async with self._turn(session):
            await self._remove(session, name)

    async def _remove(self, session: Session, name: str) -> None:
        link = session.access.link
        if not isinstance(link, SharedPortLink) or name not in {one.text for one in link.shares}:
            raise DomainError("not-found", f"Share {name:.80} not found.", "It may have been ended.")
        await link.request("unshare", name=name)
        link.shares[:] = [one for one in link.shares if one.text != name]
        if not link.shares:
            await link.request("end")
            await session.access.use_link(link.inner)
            self._unfollow(session.info.id)

    async def drop(self, session: Session, client: int) -> None:
        """Disconnect a client; it may connect again.

        Raises:
            DomainError: there is no such client.
        """
        link = session.access.link
        if not isinstance(link, SharedPortLink) or client not in {
            one["number"] for one in link.state.get("clients", ())
        }:
            raise DomainError("not-found", f"Client {client} not found.", "It may have left.")
        await link.request("drop", number=client)

    async def take_over(self, session: Session, *, confirmed: bool) -> None:
        """End the configuration of the device that a client has begun and not finished.

        Raises:
            DomainError: "confirm" with the name of the program until it is confirmed; "not-now": no client configures
                it.
        """
        link = session.access.link
        client = link.state.get("configuring") if isinstance(link, SharedPortLink) else None
        if not isinstance(link, SharedPortLink) or client is None:
            raise DomainError("not-now", "No program is configuring the device now.", "Send what you want to send.")
        name = link.name_of(client) or "A program"
        if not confirmed:
            words = f"{name} is configuring the device and has not finished; what it sends next may be refused."
            raise DomainError("confirm", words, "Send it again with `confirmed` to take over.")
        await link.request("take-over", number=client)
        self._report(session, "warning", f"A user took over from {name}, which was configuring the device.")


def _news(name: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Sentences on what happened to a client that was there before."""
    if now["dropped_bytes"] and not before["dropped_bytes"]:
        yield f"{name} does not read fast enough and loses whole frames."
    if now.get("limited") and not before.get("limited"):
        yield f"{name} sends more than the line carries and is held back."
    if now["may_write"] and now["refused"] and not before["refused"]:
        yield f"What {name} sent was refused: the device was not free for it in time."
    if now.get("refused_baud") and now.get("refused_baud") != before.get("refused_baud"):
        yield f"{name} set {now['refused_baud']} Bd, which the port does not support; it keeps its rate."


def log_frames(
    controller: DeviceController, peer: str, data: bytes, time: float, on_frame: Callable[[Mapping[str, Any]], None]
) -> bytes:
    """Log every frame of a client, sent at a time; returns the beginning of a frame that is not complete."""
    while data:
        line = controller.log.decode(data)
        if line is None:
            break
        end = int(line["offset"]) + int(line["size"])
        controller.log.client_sent(peer, data[int(line["offset"]) : end], line, time)
        on_frame(line)
        data = data[end:]
    if len(data) > MOST_PARTIAL:
        controller.log.client_sent(peer, data, {}, time)
        return b""
    return data


async def _opened(session: Session, link: SharedPortLink) -> None:
    """Wait until the session has opened a link.

    Raises:
        DomainError: it could not.
    """
    while not link.is_connected:
        if session.is_closed:
            raise DomainError("not-found", f"{session.info.name} was removed.", "Add it again.")
        if session.info.next_attempt is not None or session.info.status == "denied":
            raise DomainError("refused", session.info.message, session.info.hint)
        await asyncio.sleep(POLL_S)


def speaker_name(link: Link) -> str:
    """The speaker that has the voice: "imuscope" or a client; "" for none."""
    speaker = link.state.get("speaker") if isinstance(link, SharedPortLink) else None
    if speaker is None or not isinstance(link, SharedPortLink):
        return ""
    return "imuscope" if speaker == SERVER else link.name_of(speaker)


def client_name(link: Link, client: Mapping[str, Any]) -> str:
    """Name of a client, else its address."""
    return link.name_of(client["number"]) if isinstance(link, SharedPortLink) else str(client["peer"])


def _check_path(address: ShareAddress) -> None:
    """A page may create terminals in the runtime folder only; elsewhere, the user who starts the server may."""
    try:
        folder = runtime_folder()
    except OSError as error:
        raise DomainError("denied", f"There is no folder for shares: {error}.", "Set XDG_RUNTIME_DIR.") from None
    place = address.path.rpartition("/")[0]
    if place != str(folder):
        hint = f"Choose {folder}/NAME, or start the server with --share {address.path}."
        raise DomainError("file-not-allowed", f"From the page, a port is shared in {folder} only.", hint)


def _sentence(error: Exception) -> str:
    text = str(error)
    return text[:1].upper() + text[1:]
