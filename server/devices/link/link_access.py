"""Access to the link of a session, for configuration and port sharing.

    device_controller.py, rollback.py …  ──send, reopen, check_rate, suppress_timeout──>  LinkAccess  ──>  Link
    port_shares.py                       ──use_link──────────────────────────────────>      │ LinkReader (Session)

A caller that sends to the device holds `turn` (session_listeners.py), so that no other one does at the same time;
`wait_idle` waits for those that do.
"""

import asyncio
from collections.abc import Callable
from typing import Protocol

from imuscope.server.devices.decode.decode_pipeline import DecodePipeline
from imuscope.server.devices.device.device_demux import LinkDevices
from imuscope.server.devices.device.silence_watchdog import SilenceWatchdog
from imuscope.server.devices.link.session_listeners import SessionListeners
from imuscope.server.links.base import Link

IDLE_POLL_S = 0.05


class LinkReader(Protocol):
    """Reads from the link and decodes: the session."""

    def start_reading(self, *, opened: bool = False) -> None:
        """Begin to read; `opened`: the link is open already."""

    async def interrupt(self, message: str) -> None:
        """Stop reading and decode the received bytes; the link is opened again next. LinkError: it was removed."""

    def drain(self) -> bool:
        """Decode a slice of received bytes; true if more is waiting."""


class LinkAccess:
    """Link of one session; the session itself reads from it, opens it again after a loss, and decodes.

    Args:
        link: closed.
        listeners: receive the sent bytes.
        reader: stops and starts while the link is opened again.
        pipeline: decodes the bytes of the link.
        devices: on the link.
        now: clock of the server, unix s.
    """

    def __init__(
        self,
        link: Link,
        listeners: SessionListeners,
        reader: LinkReader,
        pipeline: DecodePipeline,
        devices: LinkDevices,
        now: Callable[[], float],
    ) -> None:
        self.silence = SilenceWatchdog()
        self._link, self._listeners, self._reader = link, listeners, reader
        self._pipeline, self._devices, self._now = pipeline, devices, now
        self._sending = asyncio.Lock()

    async def send(self, data: bytes) -> int:
        """Write to the device, one caller at a time, and pass the sent data to the listeners.

        Returns:
            when it was written, as Chunk.arrival_ns.

        Raises:
            LinkError: it could not be sent completely, or the link is read-only (a file).
        """
        async with self._sending:
            began_ns = self._link.settings.now_ns()  # before: an answer must not seem older than its request
            self._link.expect_reply()
            written_ns = await self._link.write(data)
            written_ns = began_ns if written_ns is None else written_ns
            self._listeners.sent.call(data, written_ns)
            return written_ns

    async def reopen(self, baud: int | None = None) -> None:
        """Close the link and open it again, at another rate if given, with a new decoder.

        Raises:
            LinkError: it could not be opened; retries continue as after any loss.
        """
        await self._reader.interrupt(f"Opening {self._link.source}{f' at {baud} Bd' if baud else ''}.")
        try:
            await self._link.reopen(baud)
        except BaseException:
            self._reader.start_reading()
            raise
        self._reader.start_reading(opened=True)
        await asyncio.sleep(0)  # it has begun to read when this returns

    @property
    def link(self) -> Link:
        return self._link

    async def use_link(self, link: Link) -> None:
        """Continue on another link to the same device: id, channels, history and listeners stay.

        Raises:
            LinkError: the device was removed.
        """
        await self._reader.interrupt(f"Opening {link.source}.")
        await self._link.close()
        link.flow = self._link.flow
        self._link = link
        self._pipeline.use_link(link)
        self._reader.start_reading()

    @property
    def other_users(self) -> str:
        """Names of the programs that use the device beside this server: nothing is sent then unasked."""
        return self._link.other_users

    @property
    def capacity(self) -> float | None:
        """Bytes/s that the link can carry, None if unknown."""
        return self._link.capacity

    @property
    def baud(self) -> int | None:
        """The present baud rate of the link."""
        return self._link.baud

    def suppress_timeout(self, on: bool, device: str = "") -> None:
        """Ignore silence while `on` (a device that is being configured does not measure)."""
        self._link.hold_clients(on)
        self.silence.suppress(on, self._now())
        self._devices.suppress_timeout(device, on)

    async def wait_idle(self) -> None:
        """Wait until the device is not being configured: data must not get between a request and its answer."""
        while self.silence.suppressed:
            await asyncio.sleep(IDLE_POLL_S)

    def decode(self) -> None:
        """Decode the received bytes now instead of in the next turn."""
        self._reader.drain()

    def bytes_at(self, offset: int, size: int) -> bytes:
        return self._pipeline.bytes_at(offset, size)
