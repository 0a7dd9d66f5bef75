"""Clients of a shared port: a program at a pseudo-terminal, a TCP connection, the receiver of datagrams."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
import termios
from functools import partial

from imuscope.server.concurrency.limiters import TokenBucket
from imuscope.server.extensions.shares.holder.client_frames import ClientFrames
from imuscope.server.extensions.shares.holder.queues import ClientQueue, FrameSize
from imuscope.server.system.light_modules import INFINITY, Any

READ_BYTES = 1 << 12
MOST_DATAGRAM = 1400  # within the payload of an Ethernet frame
BURST_S, LEAST_BURST = 0.25, 2048  # a burst is at least one large frame


def sendable(budget: TokenBucket, now: float, rate: float) -> int:
    """Bytes that a client may send now: as many as the line carries, with short bursts.

    Args:
        now: monotonic, s.
        rate: bytes/s of the line since the last call.
    """
    budget.change(rate, max(LEAST_BURST, rate * BURST_S), now)
    return int(budget.available(now))


class Client:
    """One client.

    Attributes:
        number: unique in this run of the holder, from 1 on.
        share: name of its share.
        peer: "127.0.0.1:50312", or the path of the terminal.
        may_write: whether its bytes go to the device.
        sent, received: bytes to it and from it.
        terminal: "/dev/pts/7", its end of a pseudo-terminal; "" for others.
        baud, last_baud: rate of its terminal, now and at the last check; None for others.
        wanted_baud, wanted_since: rate that the port is to follow it to, and since when; None for none.
        refused: bytes of it that did not go to the device: it may only read, or the device was not free in time.
        paused_since: since when it waits for the voice, monotonic s; 0: it does not.
        budget, frames: of what it sends.
        refused_baud: rate that it set last and the port does not support; None for none.
        held_since: since when it is not read.
        limited_until, limited_s: until when it counts as held back because it sends more than the line carries, and how
            long it was, all in all.
    """

    def __init__(self, number: int, share: str, peer: str, fd: int, *, may_write: bool, terminal: str = "") -> None:
        self.number, self.share, self.peer, self.fd = number, share, peer, fd
        self.may_write = may_write
        self.terminal = terminal
        self.queue = ClientQueue()
        self.sent = self.received = self.refused = 0
        self.baud: int | None = None
        self.last_baud: int | None = None
        self.wanted_baud: int | None = None
        self.wanted_since = 0.0
        self.paused_since = 0.0
        self.refused_baud: int | None = None
        self.held_since = self.limited_until = self.limited_s = 0.0
        self.budget = TokenBucket(0.0, INFINITY, 0.0)  # until the line is known
        self.frames = ClientFrames()

    def put(self, data: bytes, frame_size: FrameSize | None) -> bool:
        """Send bytes of the device, as far as the client takes them now.

        Returns:
            Whether the rest begins to wait, until the client takes more (`flush`).

        Raises:
            OSError: the client is gone.
        """
        waited = self.queue.size
        if not waited:
            try:
                n = os.write(self.fd, data)
            except BlockingIOError:
                n = 0
            self.sent += n
            if n == len(data):
                return False
            data = data[n:]
        self.queue.put(data, frame_size)
        return not waited

    def flush(self) -> None:
        """Send what waits, as far as the client takes it now.

        Raises:
            OSError: the client is gone.
        """
        self.sent += self.queue.send(partial(os.write, self.fd))

    def read(self, most: int = READ_BYTES) -> bytes:
        """Bytes from it, not more than `most`.

        Raises:
            BlockingIOError: there are none.
            OSError: it is gone.
        """
        data = os.read(self.fd, min(most, READ_BYTES))
        if not data:
            raise OSError(errno.EPIPE, "closed")
        self.received += len(data)
        return data

    @property
    def unread(self) -> int:
        """Bytes for it that its system has not taken, here and in the socket."""
        with contextlib.suppress(OSError):
            return self.queue.size + int(struct.unpack("i", fcntl.ioctl(self.fd, termios.TIOCOUTQ, bytes(4)))[0])
        return self.queue.size

    def state(self, now: float) -> dict[str, Any]:
        """For the server."""
        return {
            "number": self.number,
            "share": self.share,
            "peer": self.peer,
            "terminal": self.terminal,
            "may_write": self.may_write,
            "paused": self.paused_since > 0,
            "sent": self.sent,
            "received": self.received,
            "refused": self.refused,
            "limited": now < self.limited_until,
            "limited_s": round(self.limited_s, 2),
            "waiting": self.queue.size,
            "dropped_bytes": self.queue.dropped_bytes,
            "dropped_frames": self.queue.dropped_frames,
            "baud": self.baud,
            "refused_baud": self.refused_baud,
        }


class UdpClient(Client):
    """The receiver of the datagrams. Without a receiver the data is lost, as with any datagram."""

    def put(self, data: bytes, frame_size: FrameSize | None) -> bool:
        for at in range(0, len(data), MOST_DATAGRAM):
            piece = data[at : at + MOST_DATAGRAM]
            try:
                os.write(self.fd, piece)
                self.sent += len(piece)
            except ConnectionRefusedError:
                pass  # no process listens there now
            except OSError:
                self.queue.dropped_bytes += len(piece)
        return False

    def flush(self) -> None:
        return

    def read(self, most: int = READ_BYTES) -> bytes:
        try:
            data = os.read(self.fd, 1 << 16)
        except ConnectionRefusedError:
            raise BlockingIOError from None
        self.received += len(data)
        if len(data) > most:  # a sender of datagrams cannot be held back
            self.refused += len(data)
            raise BlockingIOError
        return data
