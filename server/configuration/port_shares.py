"""Shares of the ports of devices: which there are, who is at them, and what their clients send.

    session ── HeldLink ── holder ──┬── clients
       ^           │                 └── port
       └───────────┴── events, traffic log and recording of what clients send

A device whose port is not shared yet keeps its session: only its link is replaced.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

from server.configuration.controllers import ControllerRegistry
from server.configuration.device_controller import DeviceController
from server.devices.session import Session
from server.devices.sessions import Sessions
from server.errors import DomainError
from server.holder.arbiter import SERVER
from server.holder.places import runtime_folder
from server.holder.shares import ShareAddress, ShareError
from server.links.base import Link, LinkError
from server.links.held import ClientData, HeldLink, is_held
from server.links.serial import SerialLink
from server.links.tcp import TcpLink
from server.streaming.bus import TelemetryBus

MOST_SHARES = 8
LOOK_S = 0.02
MOST_PARTIAL = 4096  # bytes of a client without a frame, after which they are logged as they are
PORTS = "A serial port or a TCP connection can be shared."


class PortShares:
    """The shares of all devices.

    Args:
        given: addresses by source, offered from the start; checked already (server/config.py).
    """

    def __init__(
        self,
        bus: TelemetryBus,
        sessions: Sessions,
        controllers: ControllerRegistry,
        given: Mapping[str, Sequence[str]],
    ) -> None:
        self._bus = bus
        self._controllers = controllers
        self._given = {source: [ShareAddress.parse(text) for text in texts] for source, texts in given.items()}
        self._partial: dict[tuple[str, int], bytes] = {}  # of a frame of a client, by device and client
        sessions.on_added(self._on_added)

    def shared(self, link: Link) -> Link:
        """The link of a source that is shared from the start, or whose port a holder has already (`imuscope hold`, or
        left by an earlier server), in place of the one that would open the port itself.

        Raises:
            LinkError: "bad-source": this kind of link cannot be shared.
        """
        shares = self._given.get(link.source, [])
        if not shares and not (isinstance(link, SerialLink | TcpLink) and is_held(link)):
            return link
        if not isinstance(link, SerialLink | TcpLink):
            raise LinkError("bad-source", f"{link.source} has no port that can be shared.", PORTS)
        return HeldLink(link, shares, link.settings)

    def _on_added(self, session: Session) -> None:
        if isinstance(session.link, HeldLink):
            self._follow(session, session.link)

    def _follow(self, session: Session, link: HeldLink) -> None:
        known: dict[int, Mapping[str, Any]] = {}
        off = [
            link.on_state.add(lambda state: self._on_state(session, known, state)),
            link.on_client_data.add(lambda data: self._on_client_data(session, data)),
        ]

        async def closing() -> None:
            for one in off:
                one()

        session.before_close(closing)

    # ── what clients do ──────────────────────────────────────────────────────────────────────────────────────────────

    def _on_state(self, session: Session, known: dict[int, Mapping[str, Any]], state: Mapping[str, Any]) -> None:
        """Report clients that came, left or lost bytes, and a rate that a client set."""
        now = {one["number"]: one for one in state["clients"]}
        for number, one in now.items():
            if number not in known:
                rights = "may write" if one["may_write"] else "only reads"
                self._report(session, "info", f"{one['peer']} is connected to the shared port and {rights}.")
            elif one["dropped_bytes"] and not known[number]["dropped_bytes"]:
                self._report(session, "warning", f"{one['peer']} does not read fast enough and loses whole frames.")
        for number in set(known) - set(now):
            one = known[number]
            lost = f" It lost {one['dropped_bytes']} B that it did not read in time." if one["dropped_bytes"] else ""
            self._report(session, "info", f"{one['peer']} left the shared port.{lost}")
        known.clear()
        known.update(now)
        if state["open"] and state["baud"] and state["baud"] != session.info.baud and session.info.baud:
            session.devices.own.state.set(baud=state["baud"])
            by = next((one["peer"] for one in now.values() if one["baud"] == state["baud"]), "A client")
            self._report(session, "warning", f"{by} set the port to {state['baud']} Bd.")

    def _report(self, session: Session, level: Any, text: str) -> None:
        self._bus.event(session.info.id, "link", level, text, data={"kind": "share"})

    def _on_client_data(self, session: Session, sent: ClientData) -> None:
        session.note_sent(sent.data, sent.arrival_ns)
        try:
            controller = self._controllers.get(session.info.id)
        except KeyError:
            return
        key = session.info.id, sent.client
        data = self._partial.pop(key, b"") + sent.data
        rest = log_frames(controller, sent.peer, data)
        if rest:
            self._partial[key] = rest

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
        link = session.link
        if isinstance(link, HeldLink):
            shares = [ShareAddress.from_json(one) for one in link.state.get("shares", ())]
            return link.state, shares or link.shares, ""
        if isinstance(link, SerialLink | TcpLink):
            return {}, (), ""
        return {}, (), f"{session.info.source} has no port that can be shared. {PORTS}"

    async def add(self, session: Session, text: str) -> None:
        """Share the port of a device.

        Raises:
            DomainError: the address is invalid, or cannot be offered.
        """
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
        link = session.link
        if isinstance(link, HeldLink):
            await link.request("share", share=address.to_json())
            link.shares.append(address)
            return
        assert isinstance(link, SerialLink | TcpLink)
        held = HeldLink(link, [address], link.settings)
        self._follow(session, held)
        await session.use_link(held)
        try:
            await _opened(session, held)
        except DomainError:
            await session.use_link(link)
            raise

    async def remove(self, session: Session, name: str) -> None:
        """End a share and disconnect its clients. The last one gives the port back to this server.

        Raises:
            DomainError: there is no such share.
        """
        link = session.link
        if not isinstance(link, HeldLink) or name not in {one.text for one in link.shares}:
            raise DomainError("not-found", f"Share {name:.80} not found.", "It may have been ended.")
        await link.request("unshare", name=name)
        link.shares[:] = [one for one in link.shares if one.text != name]
        if not link.shares:
            await link.request("end")
            await session.use_link(link.inner)

    async def drop(self, session: Session, client: int) -> None:
        """Disconnect a client; it may connect again.

        Raises:
            DomainError: there is no such client.
        """
        link = session.link
        if not isinstance(link, HeldLink) or client not in {one["number"] for one in link.state.get("clients", ())}:
            raise DomainError("not-found", f"Client {client} not found.", "It may have left.")
        await link.request("drop", number=client)


def log_frames(controller: DeviceController, peer: str, data: bytes) -> bytes:
    """Log every frame of a client; returns the beginning of a frame that is not complete."""
    while data:
        line = controller.log.decode(data)
        if line is None:
            break
        end = int(line["offset"]) + int(line["size"])
        controller.log.client_sent(peer, data[int(line["offset"]) : end], line)
        data = data[end:]
    if len(data) > MOST_PARTIAL:
        controller.log.client_sent(peer, data, {})
        return b""
    return data


async def _opened(session: Session, link: HeldLink) -> None:
    """Wait until the session has opened a link.

    Raises:
        DomainError: it could not.
    """
    while not link.is_connected:
        if session.info.next_attempt is not None or session.info.status == "denied":
            raise DomainError("refused", session.info.message, session.info.hint)
        await asyncio.sleep(LOOK_S)


def speaker_name(state: Mapping[str, Any]) -> str:
    """The speaker that has the voice: "imuscope" or a client; "" for nobody."""
    speaker = state.get("speaker")
    if speaker is None:
        return ""
    if speaker == SERVER:
        return "imuscope"
    return next((str(one["peer"]) for one in state["clients"] if one["number"] == speaker), "")


def _check_path(address: ShareAddress) -> None:
    """A page may create terminals in the runtime folder only; elsewhere, the person who starts the server may."""
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
