"""What of a stream of corrections stands in a device's log, and so in its recording?

Its messages go to the device all day, many a second: a line for each would bury everything else. All their bytes are in
a recording as they were sent (tx/<device>); the log says where the stream begins, with the first frame, where it breaks
and why, that the device refuses, and at the end what went through:

    Corrections from tcp://10.0.0.2:2101 are forwarded.
    Corrections stopped: The stream broke: reset. Forwarded so far: 96 messages, 21 kB (1005 × 4, 1077 × 92).
    Corrections from tcp://10.0.0.2:2101 ended. Forwarded: 214 messages, 47 kB (1005 × 9, 1077 × 205), 2 refused.

A stream that cannot be opened is tried again and again; the same reason is told once.
"""

from __future__ import annotations

from collections import Counter
from typing import Protocol

from server.wire import Level

KINDS_TOLD = 8


class LogSink(Protocol):
    """Takes a sentence; `frame`: the bytes that were sent, b"" where it is about none."""

    def __call__(self, frame: bytes, text: str, level: Level) -> None: ...


def ignore(frame: bytes, text: str, level: Level) -> None:
    """Takes nothing down."""


class CorrectionLog:
    """Of one stream into one device.

    Args:
        source: where it comes from, without its password.
    """

    def __init__(self, source: str, tell: LogSink) -> None:
        self.messages: Counter[str] = Counter()
        self._source = source
        self._tell = tell
        self._bytes = 0
        self._refused = 0
        self._going = False
        self._why = ""  # why it did not go, told last

    def forwarded(self, name: str, frame: bytes, size: int) -> None:
        """A message went to the device.

        Args:
            name: its number.
            frame: as it was sent.
            size: bytes of the message itself.
        """
        self.messages[name] += 1
        self._bytes += size
        if not self._going:
            self._going, self._why = True, ""
            self._tell(frame, f"Corrections from {self._source} are forwarded.", "info")

    def refused(self) -> None:
        """The device answered a message with an error; told the first time."""
        self._refused += 1
        if self._refused == 1:
            self._tell(b"", "The device refuses a correction message.", "caution")

    def stopped(self, why: str) -> None:
        """It does not go, for now."""
        if self._going or why != self._why:
            so_far = f" Forwarded so far: {self._sum()}." if self._going else ""
            self._tell(b"", f"Corrections stopped: {why}{so_far}", "caution")
        self._going, self._why = False, why

    def ended(self, why: str = "") -> None:
        """It is over."""
        if self.messages or why:
            told = f"Corrections from {self._source} ended{f': {why}' if why else '.'} Forwarded: {self._sum()}."
            self._tell(b"", told, "info")
        self._going = False

    def _sum(self) -> str:
        count = self.messages.total()
        if not count:
            return "nothing"
        size = f"{self._bytes} bytes" if self._bytes < 10_000 else f"{self._bytes / 1000:.0f} kB"
        kinds = [f"{name} × {n}" for name, n in sorted(self.messages.items())]
        if len(kinds) > KINDS_TOLD:
            kinds[KINDS_TOLD:] = [f"{len(kinds) - KINDS_TOLD} more kinds"]
        refused = f", {self._refused} refused" if self._refused else ""
        return f"{count} message{'s' if count > 1 else ''}, {size} ({', '.join(kinds)}){refused}"
