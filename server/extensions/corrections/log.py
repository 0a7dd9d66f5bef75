"""Log of correction messages, in the log of the device and in recordings.

Corrections are sent to the device continuously, many per second; a line for each would bury everything else. A
recording has all of their bytes as sent (tx/<device>). The log reports the start of the stream with its first frame,
interruptions with their cause, rejections by the device, and totals at the end:

    Corrections from tcp://10.0.0.2:2101 are forwarded.
    Corrections stopped: The stream broke: reset. Forwarded so far: 96 messages, 21 kB (1005 × 4, 1077 × 92).
    Corrections from tcp://10.0.0.2:2101 ended. Forwarded: 214 messages, 47 kB (1005 × 9, 1077 × 205), 2 refused.

A stream that cannot be opened is retried; the same reason is reported once.
"""

from collections import Counter
from typing import Protocol

from imuscope.protocols.schema.plural import counted
from imuscope.server.wire import Level

MAX_KINDS = 8


class LogSink(Protocol):
    """Receives a sentence; `frame`: the sent bytes that it is about, b"" for none."""

    def __call__(self, frame: bytes, text: str, level: Level) -> None: ...


def ignore(frame: bytes, text: str, level: Level) -> None:
    """Discard the message."""


class CorrectionLog:
    """Log of one correction stream into one device.

    Args:
        source: source of the stream, without its password.
    """

    def __init__(self, source: str, publish: LogSink) -> None:
        self.messages: Counter[str] = Counter()
        self._source = source
        self._publish = publish
        self._bytes = 0
        self._refused = 0
        self._going = False
        self._why = ""  # the cause reported last

    def forwarded(self, name: str, frame: bytes, size: int) -> None:
        """Count a message that was sent to the device.

        Args:
            name: its message number.
            frame: the bytes as sent.
            size: bytes of the message itself.
        """
        self.messages[name] += 1
        self._bytes += size
        if not self._going:
            self._going, self._why = True, ""
            self._publish(frame, f"Corrections from {self._source} are forwarded.", "info")

    def refused(self) -> None:
        """Count a message that the device rejected; the first one is reported."""
        self._refused += 1
        if self._refused == 1:
            self._publish(b"", "The device rejects a correction message.", "warning")

    def stopped(self, why: str) -> None:
        """Report an interruption of the stream."""
        if self._going or why != self._why:
            so_far = f" Forwarded so far: {self._sum()}." if self._going else ""
            self._publish(b"", f"Corrections stopped: {why}{so_far}", "warning")
        self._going, self._why = False, why

    def log_end(self, why: str = "") -> None:
        """Report the end of the stream."""
        if self.messages or why:
            text = f"Corrections from {self._source} ended{f': {why}' if why else '.'} Forwarded: {self._sum()}."
            self._publish(b"", text, "info")
        self._going = False

    def _sum(self) -> str:
        count = self.messages.total()
        if not count:
            return "nothing"
        size = counted(self._bytes, "byte") if self._bytes < 10_000 else f"{self._bytes / 1000:.0f} kB"
        kinds = [f"{name} × {n}" for name, n in sorted(self.messages.items())]
        if len(kinds) > MAX_KINDS:
            kinds[MAX_KINDS:] = [counted(len(kinds) - MAX_KINDS, "more kind")]
        refused = f", {self._refused} refused" if self._refused else ""
        return f"{counted(count, 'message')}, {size} ({', '.join(kinds)}){refused}"
