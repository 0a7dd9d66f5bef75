"""The port that a holder keeps open: a serial port, or a TCP connection to a device server."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
import termios
import time
from collections import deque
from collections.abc import Mapping

from imuscope.server.system.light_modules import Any
from imuscope.server.system.terminals import is_another, may_be_terminal, pseudo_terminal

READ_BYTES = 1 << 12  # a terminal gives no more at once, and each read allocates as much
CONNECT_S = 5.0
LOCKED_S, POLL_S = 0.5, 0.02
MOST_WAITING = 1 << 15  # bytes for the device beyond which clients are not read
NETWORK_CAPACITY = 1e6  # bytes/s, of a device server: more than any serial line behind it
EMPTY_READS = 3  # consecutive empty reads after which the port counts as gone


class PortError(Exception):
    """The port cannot be opened, or is gone. `number`: errno, 0 if unknown."""

    def __init__(self, message: str, number: int = 0) -> None:
        super().__init__(message)
        self.number = number


class Port:
    """One port, with the bytes waiting for it.

    Args:
        source: {"kind": "serial", "place", "baud", "bits", "parity", "stop", "flow"} or {"kind": "tcp", "host",
            "port"}, as server/extensions/shares/shared_port_link.py makes it.
    """

    def __init__(self, source: Mapping[str, Any]) -> None:
        self._source = source
        self.is_serial: bool = source["kind"] == "serial"
        self.baud: int | None = source.get("baud")
        self.fd = -1
        self._handle: Any = None  # serial.Serial or socket.socket
        self._waiting: deque[bytes] = deque()
        self.backlog = 0
        self._empty_reads = 0
        self._terminal: tuple[object, int] | None = None  # that was opened last

    @property
    def is_open(self) -> bool:
        return self.fd >= 0

    def open(self) -> None:
        """Open it. A program that has just ended may still have its lock: it is waited for.

        Raises:
            PortError: it cannot be opened.
        """
        deadline = time.monotonic() + LOCKED_S
        while True:
            try:
                self._open()
            except PortError as error:
                if error.number not in (errno.EAGAIN, errno.EBUSY) or time.monotonic() > deadline:
                    raise
                time.sleep(POLL_S)
            else:
                self._empty_reads = 0
                return

    def _open(self) -> None:
        if is_another(self._source.get("place", ""), self._terminal):
            raise PortError("its terminal was closed", errno.ENOENT)
        try:
            if self.is_serial:
                self._handle = self._open_serial()
                self.fd = self._handle.fd
                self._terminal = pseudo_terminal(self._source["place"])
            else:
                import socket

                self._handle = socket.create_connection((self._source["host"], self._source["port"]), CONNECT_S)
                self._handle.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._handle.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
                self._handle.setblocking(False)
                self.fd = self._handle.fileno()
        except termios.error as error:  # it has no errno: its number comes first
            raise PortError(os.strerror(error.args[0]), error.args[0]) from None
        except (OSError, ValueError) as error:
            raise PortError(str(error), getattr(error, "errno", None) or 0) from None

    def _open_serial(self) -> Any:
        import serial

        from imuscope.server.system.open_files import readers_of

        if not may_be_terminal(self._source["place"]):
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        if readers := readers_of(self._source["place"]):
            raise PortError(f"it is in use by {readers[0]}", errno.EBUSY)

        line = self._source
        return serial.Serial(
            line["place"],
            self.baud or 115_200,
            bytesize=line.get("bits", 8),
            parity=line.get("parity", "N"),
            stopbits=line.get("stop", 1),
            rtscts=line.get("flow") == "rtscts",
            xonxoff=line.get("flow") == "xonxoff",
            dsrdtr=line.get("flow") == "dsrdtr",
            timeout=0,
            exclusive=True,
        )

    @property
    def capacity(self) -> float:
        """Bytes/s that the line carries."""
        if not self.is_serial:
            return NETWORK_CAPACITY
        bits = 1 + int(self._source.get("bits", 8)) + (self._source.get("parity", "N") != "N")
        return float((self.baud or 115_200) / (bits + float(self._source.get("stop", 1))))

    def has_sent_all(self) -> bool:
        """Whether nothing waits to be sent, here or in the driver."""
        if self.backlog or not self.is_serial or self.fd < 0:
            return not self.backlog
        try:
            return not struct.unpack("i", fcntl.ioctl(self.fd, termios.TIOCOUTQ, bytes(4)))[0]
        except OSError:
            return True

    def close(self) -> None:
        """Close it, at once, whatever the device does not take. Idempotent."""
        handle, self._handle, fd, self.fd = self._handle, None, self.fd, -1
        if self.is_serial and fd >= 0:
            with contextlib.suppress(OSError, termios.error):
                termios.tcflush(fd, termios.TCOFLUSH)  # the driver would wait for up to 30 s
        self._waiting.clear()
        self.backlog = 0
        if handle is not None:
            with contextlib.suppress(OSError, termios.error):
                handle.close()

    def read(self) -> bytes:
        """The bytes that have arrived; b"" if there are none.

        Raises:
            PortError: it is gone.
        """
        try:
            data = os.read(self.fd, READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise PortError(error.strerror or "", error.errno or 0) from None
        if data:
            self._empty_reads = 0
            return data
        self._empty_reads += 1
        if not self.is_serial or self._empty_reads >= EMPTY_READS:
            raise PortError("the other side closed it", errno.ENODEV)
        return b""

    def write(self, data: bytes) -> None:
        """Send, or queue what the port does not take at once.

        Raises:
            PortError: it is gone.
        """
        if data:
            self._waiting.append(data)
            self.backlog += len(data)
        while self._waiting:
            chunk = self._waiting[0]
            try:
                sent = os.write(self.fd, chunk)
            except BlockingIOError:
                return
            except OSError as error:
                raise PortError(error.strerror or "", error.errno or 0) from None
            self.backlog -= sent
            if sent < len(chunk):
                self._waiting[0] = chunk[sent:]
                return
            self._waiting.popleft()

    def set_baud(self, baud: int) -> None:
        """Change the rate of an open serial port.

        Raises:
            PortError: the port has no rate, or does not support this one; the former one stays.
        """
        if not self.is_serial:
            raise PortError("it has no baud rate that can be set from here", errno.ENOTTY)
        before = self.baud
        try:
            if self._handle is not None:
                self._handle.baudrate = baud
                code = getattr(termios, f"B{baud}", None)
                if code is not None and termios.tcgetattr(self.fd)[5] != code:
                    raise ValueError("the driver set another rate")
        except (OSError, ValueError, termios.error) as error:
            if self._handle is not None and before is not None:
                with contextlib.suppress(OSError, termios.error):  # it is gone
                    self._handle.baudrate = before
            raise PortError(str(error), errno.EINVAL) from None
        self.baud = baud

    def try_baud(self, baud: int) -> None:
        """Set a rate and then the former one again; as set_baud."""
        before = self.baud
        self.set_baud(baud)
        if before is not None:
            self.set_baud(before)
