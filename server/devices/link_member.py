"""A further device of a link for its controller: the link's session, with the device's own messages.

    Session        the link and the first of its devices
    LinkMember     the same link, for another of its devices: its name, address, state and answers

A device controller (server/configuration/device_controller.py) uses either through the same interface.
"""

from __future__ import annotations

from collections.abc import Callable

from imuscope.protocols.events import Event
from imuscope.server import wire
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
        self.listeners, self.access = session.listeners, session.access

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


AnyDevice = Session | LinkMember
"""A device that can be configured."""


class DevicePort:
    """A device for what sends to it and waits for its answers: a transaction, or a stream of corrections."""

    def __init__(self, device: AnyDevice) -> None:
        self.device = device

    @property
    def info(self) -> wire.DeviceInfo:
        """The published state of the device."""
        return self.device.info

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Call `callback` with every event of this device; see SessionListeners.listen."""
        return self.device.listeners.listen(callback, name_of(self.device))

    async def send(self, data: bytes) -> int:
        """Write to the line; see LinkAccess.send."""
        return await self.device.access.send(data)

    async def reopen(self, baud: int | None = None) -> None:
        """Close the link and open it again; see LinkAccess.reopen."""
        await self.device.access.reopen(baud)

    def decode(self) -> None:
        """Decode the received bytes now instead of in the next turn."""
        self.device.access.decode()

    async def wait_idle(self) -> None:
        """Wait until no device of the link is being configured."""
        await self.device.access.wait_idle()


def suppress_timeout(device: AnyDevice, on: bool) -> None:
    """Ignore silence of a device while `on`; see LinkAccess.suppress_timeout."""
    device.access.suppress_timeout(on, name_of(device))


def name_of(device: AnyDevice) -> str:
    """Name of the device in the stream; "" for the first of its link."""
    return device.name if isinstance(device, LinkMember) else ""


def link_of(device: AnyDevice) -> Session:
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
