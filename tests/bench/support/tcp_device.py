"""A fast device on a TCP connection that records the sending time of each byte.

with TcpDevice(rate=2000) as line:
    serve(line.source)
    line.sent            all bytes that were sent
    line.sent_at(n)      when byte n was, monotonic s
"""

from __future__ import annotations

import bisect
import contextlib
import socket
import threading
import time

from tests.bench.support.serial_device import frame
from tests.support.timeouts import PATIENCE_S


class TcpDevice:
    """Sends frames (tests/bench/support/serial_device.py) to who connects, until that one goes or the block ends.

    Args:
        rate: frames per second.
    """

    def __init__(self, rate: float = 2000.0) -> None:
        self._rate = rate
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.source = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._stop = threading.Event()
        self._paused = threading.Event()
        self._sending = threading.Lock()
        self._pieces: list[bytes] = []
        self._ends: list[int] = []
        self._times: list[float] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def pause(self) -> None:
        """Send nothing more. Connected it stays."""
        self._paused.set()
        with self._sending:  # none is half noted any more
            pass

    @property
    def sent(self) -> bytes:
        """Everything so far."""
        return b"".join(self._pieces)

    @property
    def size(self) -> int:
        """Number of bytes sent."""
        return self._ends[-1] if self._ends else 0

    def sent_at(self, place: int) -> float:
        """Time at which the byte at this position was passed to the kernel, monotonic s."""
        return self._times[bisect.bisect_right(self._ends, place)]

    def _run(self) -> None:
        self._listener.settimeout(60)
        with contextlib.suppress(OSError):
            connection, _ = self._listener.accept()
            with connection:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._send(connection)

    def _send(self, connection: socket.socket) -> None:
        started, n = time.monotonic(), 0
        while not self._stop.is_set():
            due = int((time.monotonic() - started) * self._rate) + 1
            with self._sending:
                while n < due and not self._paused.is_set():
                    data = frame(n, self._rate)
                    self._times.append(time.monotonic())
                    self._pieces.append(data)  # noted before it can be received, to be compared with the recording
                    connection.sendall(data)
                    self._ends.append(self.size + len(data))
                    n += 1
            if self._paused.is_set():
                self._stop.wait()
                return
            time.sleep(0.5 / self._rate)

    def __enter__(self) -> TcpDevice:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        with contextlib.suppress(OSError):  # notifies a waiting accept; closing alone would leave it waiting
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(PATIENCE_S)
