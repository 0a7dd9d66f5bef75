"""A further device of a link, as who configures it sees it: the link's session, and of all that is heard there its own.

    Session        everything about the link; of the devices on it, the first
    Member         the same link, for another of its devices: its name, address and state, its answers

Whoever configures a device (server/configuration/device_controller.py) is given one or the other and need not know
which.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from protocols.events import Event
from server import wire
from server.devices.decode_options import DecodeOptions
from server.devices.device_demux import LinkDevice
from server.devices.session import Session


class Member:
    """See above.

    Args:
        sender: the device; not the link's own.
    """

    def __init__(self, session: Session, sender: LinkDevice) -> None:
        self.session = session
        self._sender = sender
        self.turn = session.turn

    @property
    def info(self) -> wire.DeviceInfo:
        """The device as the page knows it."""
        return self._sender.portrait.info

    @property
    def name(self) -> str:
        """What the stream calls it."""
        return self._sender.name

    @property
    def reading(self) -> DecodeOptions:
        """How the link's bytes are read."""
        return self.session.reading

    @property
    def baud(self) -> int | None:
        """The rate of the link now."""
        return self.session.baud

    @property
    def capacity(self) -> float | None:
        """Bytes/s that the link carries, for all of its devices together."""
        return self.session.capacity

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Call `callback` with every event of this device; see Audience.listen."""
        return self.session.listen(callback, self.name)

    def on_sent(self, callback: Callable[[bytes, int], None]) -> Callable[[], None]:
        """Call `callback(data, time)` with all that is sent on the link; returns what takes it off."""
        return self.session.on_sent(callback)

    def before_close(self, last: Callable[[], Awaitable[None]]) -> None:
        """Have something done before the link is closed for good."""
        self.session.before_close(last)

    def hush(self, on: bool) -> None:
        """Its silence is meant."""
        self.session.hush(on, self.name)

    async def send(self, data: bytes) -> None:
        """Write to the line. LinkError: as Session.send."""
        await self.session.send(data)

    async def relink(self, baud: int | None = None) -> None:
        """Close the link and open it again. LinkError: as Session.relink."""
        await self.session.relink(baud)

    async def check_rate(self, baud: int) -> None:
        """Can this end of the link do that rate? As Link.check_rate."""
        await self.session.check_rate(baud)

    async def read_as(self, reading: DecodeOptions) -> None:
        """Read the link's bytes in another way. As Session.read_as."""
        await self.session.read_as(reading)

    async def idle(self) -> None:
        """Wait until nobody configures a device of the link."""
        await self.session.idle()

    def decode(self) -> None:
        """Decode what has come now instead of with the next flush."""
        self.session.decode()

    def bytes_at(self, offset: int, size: int) -> bytes:
        """Bytes of this connection from an offset that the decoder told; b"" where they are gone."""
        return self.session.bytes_at(offset, size)


AnyDevice = Session | Member
"""A device that can be configured."""


def name_of(device: AnyDevice) -> str:
    """What the stream calls it; "" for the first of its link."""
    return device.name if isinstance(device, Member) else ""


def address_of(device: AnyDevice) -> int | None:
    """Where it is addressed on a line that devices share; None where it has no address, or told none yet."""
    session = device.session if isinstance(device, Member) else device
    return session.senders.addresses.get(name_of(device))


def explain_silence(device: AnyDevice, hint: str) -> None:
    """What a person is to do about its silence, where a reason for that is known; "" where there is none."""
    session = device.session if isinstance(device, Member) else device
    sender = session.senders.of(name_of(device))
    if sender is not None:
        sender.silence_hint = hint


def shares(device: AnyDevice) -> bool:
    """Are there other devices on its link?"""
    session = device.session if isinstance(device, Member) else device
    return bool(session.senders.others)
