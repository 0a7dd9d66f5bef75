"""Does a stream hold messages of another protocol than the one it is read as?

    read as     [own frame][own frame]················[own frame]
    others                  ^^ chance    [theirs][theirs]
                               not counted       counted: they share no byte with a frame of the protocol's own

Only frames are looked for, by the compiled scanners, so that a whole file can be examined: a short stretch in the
middle counts like a long one. Bytes inside a frame whose checks hold are that frame's, whatever they look like; in what
is left, three frames whose checks hold are hardly chance. (Xbus has a sum of one byte alone: noise holds a frame every
60 kB. So of its frames those count that come from the device itself, bus identifier FF, with a message that there is:
one in some 50 MB.)
"""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from protocols.events import RejectedFrame, Text
from protocols.framing import ID, OFFSET, SIZE, Ints, Scan
from protocols.idtp.frames import LITE, scanner
from protocols.isb.frames import scan as isb_scan
from protocols.nmea import ParsedMessage
from protocols.stream_parser import StreamParser
from protocols.xbus.frames import scan as xbus_scan
from protocols.xbus.messages import ROWS

FEW = 3  # frames of another protocol; fewer may be chance
MASTER = 0xFF  # bus identifier of a device that is not one of many
MESSAGES = np.array(sorted(ROWS))


class _Bare(StreamParser):
    """Frames alone: messages that pass through any port are nobody's own."""

    def __init__(self, scan: Scan) -> None:
        super().__init__(scan, _nothing, _NEVER)

    def _stretches(
        self, data: bytes, start: int, table: Ints, texts: list[Text], rejects: list[RejectedFrame], stalled: bool
    ) -> None:
        self._find_at = self._scan_at


def _nothing(data: bytes, *, final: bool) -> tuple[list[ParsedMessage], int]:
    return [], len(data)


_NEVER = re.compile(rb"(?!)")


class _Frames:
    """The frames of one protocol in a stream: where each begins and ends."""

    def __init__(self, name: str, stream: StreamParser) -> None:
        self._stream = stream
        self._weak = name == "xbus"
        self._fed = 0
        self.spans: Ints = np.empty((2, 0), np.int64)

    def feed(self, data: bytes, *, final: bool, believed: bool) -> None:
        """Take a chunk; `believed` leaves out what may well be chance."""
        self._stream.feed(data, 0)
        self._fed += len(data)
        cut = self._stream.drain(stalled=final)
        table = cut.table
        if believed and self._weak:
            table = table[:, (cut.array[table[OFFSET] + 1] == MASTER) & np.isin(table[ID], MESSAGES)]
        begins = table[OFFSET] + cut.start
        self.spans = np.concatenate((self.spans, np.stack((begins, begins + table[SIZE]))), axis=1)

    @property
    def decided(self) -> int:
        """The position up to which all frames are known."""
        return self._fed - self._stream.buffered

    def forget(self, before: int) -> None:
        """Drop the frames that end before a position."""
        self.spans = self.spans[:, np.searchsorted(self.spans[1], before) :]


class MixedProtocolDetector:
    """Counts the frames of other protocols in a stream.

    Args:
        own: the protocol that it is read as.
    Attributes:
        count: protocol → its frames so far that share no byte with one of the own protocol's.
    """

    def __init__(self, own: str) -> None:
        scans = {"xbus": xbus_scan, "isb": isb_scan, "idtp": scanner(None, LITE, show_unverified=True)}
        self._own = _Frames(own, _Bare(scans.pop(own)))
        self._others = {name: _Frames(name, _Bare(scan)) for name, scan in scans.items()}
        self.count: Counter[str] = Counter()

    def feed(self, data: bytes, *, final: bool = False) -> None:
        """Examine a chunk; `final`: it is the last one."""
        own = self._own
        own.feed(data, final=final, believed=False)
        oldest = own.decided
        for name, other in self._others.items():
            other.feed(data, final=final, believed=True)
            ready = int(np.searchsorted(other.spans[1], own.decided, side="right"))
            begins, ends = other.spans[:, :ready]
            # Of the own frames that begin before one ends, the last must have ended where it begins.
            before = np.searchsorted(own.spans[0], ends)
            last = np.concatenate(([0], own.spans[1]))[before]
            if free := int((last <= begins).sum()):
                self.count[name] += free
            other.spans = other.spans[:, ready:]
            oldest = min(oldest, other.decided, *other.spans[0, :1].tolist())
        own.forget(oldest)

    @property
    def others(self) -> list[str]:
        """The protocols that are mixed in."""
        return [name for name, count in self.count.items() if count >= FEW]
