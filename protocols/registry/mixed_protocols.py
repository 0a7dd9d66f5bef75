"""Detection of messages of another protocol within a stream.

    read as     [own frame][own frame]················[own frame]
    others                  ^^ chance    [theirs][theirs]
                               not counted       counted: they do not overlap a frame of the protocol's own

Only frames are searched for, by the compiled scanners, so that a whole file can be examined: a short stretch in the
middle counts like a long one. Bytes inside a valid frame belong to that frame, whatever they look like; in the rest,
three valid frames are hardly chance. (Xbus has a checksum of one byte: noise contains a frame every 60 kB. So only
those of its frames count that come from the device itself, bus identifier FF, with a known message: one in some 50 MB.)
"""

from collections import Counter

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.events import RejectedFrame, Text
from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.framing.stream_buffer import OFFSET, SIZE
from imuscope.protocols.framing.stream_parser import StreamParser
from imuscope.protocols.registry.families import PROTOCOLS

MIN_FRAMES = 3  # frames of another protocol; fewer may be chance


class _BareStream(StreamParser):
    """Frames alone: messages that pass through any port do not count."""

    def _spans(
        self, data: bytes, start: int, table: Ints, texts: list[Text], rejects: list[RejectedFrame], stalled: bool
    ) -> None:
        self._find_at = self._scan_at


class _Frames:
    """Start and end of the frames of one protocol in a stream."""

    def __init__(self, family: ProtocolInfo) -> None:
        self._stream = _BareStream(family.frames.scan)
        self._is_certain = family.frames.is_certain
        self._fed = 0
        self.spans: Ints = np.empty((2, 0), np.int64)

    def feed(self, data: bytes, *, final: bool, believed: bool) -> None:
        """Add a chunk; `believed` leaves out frames that may be chance."""
        self._stream.feed(data, 0)
        self._fed += len(data)
        cut = self._stream.drain(stalled=final)
        table = cut.table
        if believed and self._is_certain is not None:
            table = table[:, self._is_certain(table, cut.array)]
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
        own: the protocol that decodes the stream.

    Attributes:
        count: protocol → number of its frames so far that do not overlap one of the own protocol's.
    """

    def __init__(self, own: str) -> None:
        # A stream of messages, which is not in the table, is never mixed with that of a device.
        self._own = _Frames(PROTOCOLS[own]) if own in PROTOCOLS else None
        self._others = {name: _Frames(family) for name, family in PROTOCOLS.items() if name != own}
        self.count: Counter[str] = Counter()

    def feed(self, data: bytes, *, final: bool = False) -> None:
        """Examine a chunk; `final`: it is the last one."""
        own = self._own
        if own is None:
            return
        own.feed(data, final=final, believed=False)
        oldest = own.decided
        for name, other in self._others.items():
            other.feed(data, final=final, believed=True)
            ready = int(np.searchsorted(other.spans[1], own.decided, side="right"))
            begins, ends = other.spans[:, :ready]
            # The last own frame that begins before another one ends must have ended before that one begins.
            before = np.searchsorted(own.spans[0], ends)
            last = np.concatenate(([0], own.spans[1]))[before]
            if free := int((last <= begins).sum()):
                self.count[name] += free
            other.spans = other.spans[:, ready:]
            oldest = min(oldest, other.decided, *other.spans[0, :1].tolist())
        own.forget(oldest)

    @property
    def others(self) -> list[str]:
        """The other protocols in the stream."""
        return [name for name, count in self.count.items() if count >= MIN_FRAMES]
