"""A device of a link for its controller: the link's session, with the device's own messages.

    Session        the link and the first of its devices
    LinkMember     one of its devices, the first or a further one: its name, address, state and answers

A device controller (server/configuration/device_controller.py) uses every device through it.
"""

from collections.abc import Callable

from imuscope.protocols.events import Batch, Event, Reply
from imuscope.server import wire
from imuscope.server.devices.device.device_demux import LinkDevice, QuietReason
from imuscope.server.devices.device.device_state import DeviceState
from imuscope.server.devices.device.link_stats import LinkStatistics
from imuscope.server.devices.link.session import Session


class LinkMember:
    """A device that can be configured.

    Args:
        sender: a further device of the link; None: the link's own.

    Attributes:
        link_session: of its link.
        name: in the stream; "" for the link's own.
    """

    def __init__(self, session: Session, sender: LinkDevice | None = None) -> None:
        self.link_session = session
        self.name = sender.name if sender is not None else ""
        self.listeners, self.access = session.listeners, session.access
        self._sender = sender or session.devices.own

    @property
    def state(self) -> DeviceState:
        return self._sender.state

    @property
    def info(self) -> wire.DeviceInfo:
        """The published state of the device."""
        return self.state.info

    @property
    def address(self) -> int | None:
        """Address of the device on a shared line; None if it has none or has not reported one."""
        return self.link_session.devices.addresses.get(self.name)

    @property
    def shares_link(self) -> bool:
        """Whether its link carries other devices."""
        return bool(self.link_session.devices.others)

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Call `callback` with every event of this device; see SessionListeners.listen."""
        return self.listeners.listen(callback, self.name)

    def listen_to_news(self, callback: Callable[[Batch | Reply], None]) -> Callable[[], None]:
        """Call `callback` with its replies and the first samples after each; see SessionListeners.listen_to_news."""
        return self.listeners.listen_to_news(callback, self.name)

    def expect_samples(self) -> None:
        """Take its next samples for news."""
        self.listeners.expect_samples(self.name)

    @property
    def stats(self) -> LinkStatistics:
        """Counts of its bytes and messages."""
        return self._sender.stats

    async def send(self, data: bytes) -> int:
        """Write to the line; see LinkAccess.send."""
        return await self.access.send(data)

    async def reopen(self, baud: int | None = None) -> None:
        """Close the link and open it again; see LinkAccess.reopen."""
        await self.access.reopen(baud)

    def decode(self) -> None:
        self.access.decode()

    async def wait_idle(self) -> None:
        """Wait until no device of the link is being configured."""
        await self.access.wait_idle()

    def suppress_timeout(self, on: bool) -> None:
        """Ignore silence of the device while `on`; see LinkAccess.suppress_timeout."""
        self.access.suppress_timeout(on, self.name)

    def explain_pause(self, job: str) -> None:
        """Name the job that stops the device; "" when it sends again."""
        self._sender.events.job = job

    def explain_silence(self, reason: QuietReason | None) -> None:
        """Set the reason for which the device will send nothing; None: there is none any more."""
        self._sender.quiet_reason = reason
