"""A further device of a link for its controller: the link's session, with the device's own messages.

    Session        the link and the first of its devices
    LinkMember     the same link, for another of its devices: its name, address, state and answers

A device controller (server/configuration/device_controller.py) uses either through the same interface.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from imuscope.protocols.events import Event
from imuscope.server import wire
from imuscope.server.devices.decode_options import DecodeOptions
from imuscope.server.devices.device_demux import LinkDevice, QuietReason
from imuscope.server.devices.device_state import DeviceState
from imuscope.server.devices.session import Session


class LinkMember:
    """A further device of a link.

    Args:
        sender: the device; not the link's own.
    """

    def __init__(self, session: Session, sender: LinkDevice) -> None:
        self.session = session
        self._sender = sender
        self.turn = session.turn

    @property
    def state(self) -> DeviceState:
        """The state that is published."""
        return self._sender.state

    @property
    def info(self) -> wire.DeviceInfo:
        """The published state of the device."""
        return self._sender.state.info

    @property
    def name(self) -> str:
        """Name of the device in the stream."""
        return self._sender.name

    @property
    def reading(self) -> DecodeOptions:
        """Decode options of the link."""
        return self.session.reading

    @property
    def baud(self) -> int | None:
        """The present baud rate of the link."""
        return self.session.baud

    @property
    def other_users(self) -> str:
        """Names of the programs that use the device beside this server."""
        return self.session.other_users

    @property
    def capacity(self) -> float | None:
        """Bytes/s that the link can carry, for all of its devices together."""
        return self.session.capacity

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Call `callback` with every event of this device; see SessionListeners.listen."""
        return self.session.listen(callback, self.name)

    def on_sent(self, callback: Callable[[bytes, int], None]) -> Callable[[], None]:
        """Call `callback(data, time)` with all data sent on the link; returns a function that removes it."""
        return self.session.on_sent(callback)

    def before_close(self, last: Callable[[], Awaitable[None]]) -> None:
        """Run a coroutine before the link is closed for good."""
        self.session.before_close(last)

    def suppress_timeout(self, on: bool) -> None:
        """Ignore silence of the device while `on`."""
        self.session.suppress_timeout(on, self.name)

    async def send(self, data: bytes) -> int:
        """Write to the line. Result and LinkError: as Session.send."""
        return await self.session.send(data)

    async def reopen(self, baud: int | None = None) -> None:
        """Close the link and open it again. LinkError: as Session.reopen."""
        await self.session.reopen(baud)

    async def check_rate(self, baud: int) -> None:
        """Check that this end of the link supports a rate. As Link.check_rate."""
        await self.session.check_rate(baud)

    async def read_as(self, reading: DecodeOptions) -> None:
        """Change the decode options of the link. As Session.read_as."""
        await self.session.read_as(reading)

    async def wait_idle(self) -> None:
        """Wait until no device of the link is being configured."""
        await self.session.wait_idle()

    def decode(self) -> None:
        """Decode the received bytes now instead of in the next turn."""
        self.session.decode()

    def bytes_at(self, offset: int, size: int) -> bytes:
        """Bytes of this connection from an offset of the decoder; b"" if they are no longer stored."""
        return self.session.bytes_at(offset, size)


AnyDevice = Session | LinkMember
"""A device that can be configured."""


def name_of(device: AnyDevice) -> str:
    """Name of the device in the stream; "" for the first of its link."""
    return device.name if isinstance(device, LinkMember) else ""


def link_of(device: AnyDevice) -> Session:
    """The session of its link."""
    return device.session if isinstance(device, LinkMember) else device


def state_of(device: AnyDevice) -> DeviceState:
    """The published state of the device."""
    if isinstance(device, LinkMember):
        return device.state
    return device.devices.own.state


def address_of(device: AnyDevice) -> int | None:
    """Address of the device on a shared line; None if it has none or has not reported one."""
    return link_of(device).devices.addresses.get(name_of(device))


def explain_silence(device: AnyDevice, reason: QuietReason | None) -> None:
    """Set the reason for which a device will send nothing; None: there is none any more."""
    sender = link_of(device).devices.of(name_of(device))
    if sender is not None:
        sender.quiet_reason = reason


def shares(device: AnyDevice) -> bool:
    """Whether its link carries other devices."""
    return bool(link_of(device).devices.others)
