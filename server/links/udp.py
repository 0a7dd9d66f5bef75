"""UDP link: datagrams received on a local port.

Each datagram is one chunk, so a protocol that frames by datagram (IDTP) sees its boundaries. Answers go to the last
sender, since UDP has no connection. Two senders on one port would mix into one stream, which a notice reports.

Linux counts the datagrams dropped because the receive buffer was full (SO_RXQ_OVFL); the count is shown. The requested
buffer holds seconds of a 2 kHz stream; the kernel grants up to net.core.rmem_max.
"""

import contextlib
import socket
import struct

from imuscope.server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from imuscope.server.links.reader_thread import ThreadedLink
from imuscope.server.links.registry import LinkDefinition, register_link
from imuscope.server.links.source_url import SourceUrl
from imuscope.server.links.text import heading, listen_error, place_of, progress_line

BUFFER_BYTES = 4 << 20
MAX_DATAGRAM = 65_535
DATAGRAMS_PER_WAKE = (
    64  # datagrams read per wake-up of the thread: a burst costs one wait, and the thread still stops promptly
)
SO_RXQ_OVFL = 40  # Linux, asm-generic/socket.h; not in the socket module
MAX_SENDERS = 64  # senders stored; bounded because a device may use a new port for each datagram
MAX_NAMED_SENDERS = 4  # senders listed in a notice
OTHER_SENDER_NS = 2_000_000_000  # two senders within this time are two devices, not one that changed its address
_ANCILLARY = socket.CMSG_SPACE(4)


class UdpLink(ThreadedLink):
    """A UDP port.

    Attributes:
        address: address in use once open.
        lost: number of datagrams dropped by the kernel because its buffer was full.
    """

    kind = "udp"
    datagrams = True

    def __init__(self, source: str, settings: LinkSettings, host: str, port: int) -> None:
        super().__init__(source, settings)
        self.host, self.port = host, port
        self.address: tuple[str, int] = (host, port)
        self.lost = 0
        self._socket: socket.socket | None = None
        self._peer: tuple[str, int] | None = None
        self._sender_ns: dict[tuple[str, int], int] = {}

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        receiver = socket.socket(family, socket.SOCK_DGRAM)
        try:
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            receiver.bind((self.host, self.port))
        except OSError as error:
            receiver.close()
            raise listen_error(self.kind, self.host, self.port, error) from None
        receiver.setblocking(False)
        with contextlib.suppress(OSError):  # not Linux: such losses then show only as counter gaps
            receiver.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        self._socket, self._peer, self.lost = receiver, None, 0
        self._sender_ns.clear()
        self.address = receiver.getsockname()[:2]
        self.notices = [f"Waiting for datagrams on {heading(*self.address)}."]
        progress_line(progress, place_of(*self.address), "waiting for datagrams")
        self._start(receiver.fileno(), self._on_readable)

    def _on_readable(self) -> None:
        assert self._socket is not None
        assert self._queue is not None
        for _ in range(DATAGRAMS_PER_WAKE):
            try:
                data, extra, _, sender = self._socket.recvmsg(MAX_DATAGRAM, _ANCILLARY)
            except BlockingIOError:
                return
            except OSError as error:
                raise LinkError(
                    "gone", f"UDP {heading(*self.address)} failed: {error.strerror}.", "It is opened again."
                ) from None
            arrival_ns = self.settings.now_ns()
            self._notice(sender, extra, arrival_ns)
            if data:
                self._queue.put(Chunk(data, arrival_ns))

    def _notice(self, sender: tuple[str, int], extra: list[tuple[int, int, bytes]], now_ns: int) -> None:
        """Update senders and losses; called for every datagram, so it must be cheap."""
        for level, kind, value in extra:
            if level == socket.SOL_SOCKET and kind == SO_RXQ_OVFL:
                self.lost = struct.unpack("=I", value[:4])[0]
        senders = self._sender_ns
        senders.pop(sender, None)
        senders[sender] = now_ns  # the latest sender is the last entry
        self._peer = sender
        if len(senders) > MAX_SENDERS:
            del senders[next(iter(senders))]

    @property
    def notices(self) -> list[str]:
        """Senders and losses, created on request."""
        senders = list(self._sender_ns.items())
        if not senders:
            return self._waiting
        newest = senders[-1][1]
        names = sorted(place_of(*who[:2]) for who, at in senders if newest - at < OTHER_SENDER_NS)
        places = " and ".join(names) if len(names) <= MAX_NAMED_SENDERS else f"{len(names)} places"
        notices = [f"Datagrams come from {places if len(names) < MAX_SENDERS else f'{places} or more'}."]
        if len(names) > 1:
            notices.append("Their bytes are mixed into one stream: give each device its own port.")
        if self.lost:
            notices.append(
                f"{self.lost} datagrams were lost in this host's receive buffer: it was busy, or the buffer is small "
                "(`sudo sysctl net.core.rmem_max=8388608`)."
            )
        return notices

    @notices.setter
    def notices(self, waiting: list[str]) -> None:
        self._waiting = waiting

    async def write(self, data: bytes) -> None:
        if self._socket is None or self._peer is None:
            hint = "UDP answers go to the last sender: start the device first."
            raise LinkError("refused", "No address to answer: no device has sent a datagram yet.", hint)
        try:
            self._socket.sendto(data, self._peer)
        except OSError as error:
            where = place_of(*self._peer[:2])
            raise LinkError("refused", f"Cannot send to {where}: {error.strerror}.", "Check the network.") from None

    async def _release(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _open(source: str, settings: LinkSettings, parsed: SourceUrl) -> Link:
    parsed.allow(())
    return UdpLink(source, settings, *parsed.address(listening=True))


register_link(
    LinkDefinition(
        "udp",
        "UDP",
        _open,
        "udp://:port",
        usage=(("udp://[host]:port", "receive datagrams"),),
        examples=lambda: [("udp://:34555", "datagrams to a port")],
        order=30,
        network=True,
    )
)
