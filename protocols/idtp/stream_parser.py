"""Parser of an IDTP stream, chunk by chunk: accepted frames and rejects.

    chunks ──> protocols/framing/stream_parser.py ──> intact, genuine frames ──> replay_guard.py ──> new frames
                        └─> RejectedFrame: damaged, forged, too weak          └─> RejectedFrame: stale, far_ahead

Both the decoder (columns) and the listing (one line a frame) build on this. On a link of datagrams no frame crosses
from one into the next, so each is searched on its own, and an incomplete frame at its end is given up there. Datagrams
that are full of frames, as nearly all are, give the same result when searched together, and small batches become few.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, cast

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.events import RejectedFrame
from imuscope.protocols.framing.stream_buffer import OFFSET, REASONS, SENDER, SIZE
from imuscope.protocols.framing.stream_parser import ParseResult as Whole
from imuscope.protocols.framing.stream_parser import StreamParser
from imuscope.protocols.idtp.frames import DEVICE_AT, LITE, MODE_AT, SECURE, SEQUENCE_AT, scanner
from imuscope.protocols.idtp.replay_guard import LOST, MASK, TAKEN_BACK, ReplayGuard, ReplayVerdict


@dataclass(slots=True)
class ClassifiedFrames(Whole):
    """Result of one drain; n frames were accepted.

    Args:
        verdict: replay_guard.py's verdict on the accepted frames.
    """

    verdict: ReplayVerdict = field(init=False)


INTACT = ("no_key", "below_min_mode")
"""Reasons why a scan refuses a frame whose header is valid and whose number can be read."""

REFUSED_DEVICES, REFUSED_NUMBERS = 64, 4096  # remembered


class IdtpStream:
    """Cuts a stream of bytes, given in chunks, into frames and rejects.

    Args:
        key: for Secure frames.
        min_mode: LITE, SAFETY or SECURE, the weakest mode that is accepted; None: SECURE with a key, else LITE.
        replay_check: False accepts frames whatever their sequence numbers.
        show_unverified: without a key, accept Secure frames as they are; they are marked.
        datagrams: every chunk is a datagram.
        arrivals: False: the arrival times are not those of a link.

    Raises:
        ValueError: an empty key, or no such mode.
    """

    def __init__(
        self,
        *,
        key: bytes | None = None,
        min_mode: int | None = None,
        replay_check: bool = True,
        show_unverified: bool = False,
        datagrams: bool = False,
        arrivals: bool = True,
    ) -> None:
        if min_mode is None:
            min_mode = LITE if key is None else SECURE
        if min_mode not in (0, 1, 2):
            raise ValueError(f"min_mode is 0 (Lite), 1 (Safety) or 2 (Secure), given {min_mode!r}")
        scan = scanner(key, min_mode, show_unverified=show_unverified)
        self._stream = StreamParser(scan, result=ClassifiedFrames)
        self.sequences = ReplayGuard(check=replay_check, keyed=key is not None, arrivals=arrivals)
        self._refused: dict[int, deque[int]] = {}  # numbers of whole frames that were refused, by device
        self._datagrams = datagrams
        self._waiting: list[tuple[bytes, int]] = []

    def feed(self, data: bytes, arrival_ns: int) -> None:
        if self._datagrams:
            self._waiting.append((bytes(data), arrival_ns))
        else:
            self._stream.feed(data, arrival_ns)

    def feed_chunks(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None:
        if not self._datagrams:
            self._stream.feed_chunks(data, ends, arrival_ns)
            return
        start = 0
        for end, arrival in zip(ends.tolist(), arrival_ns.tolist(), strict=True):
            self._waiting.append((data[start:end], arrival))
            start = end

    @property
    def buffered(self) -> int:
        return self._stream.buffered + sum(len(data) for data, _ in self._waiting)

    @property
    def skipped(self) -> int:
        """Bytes so far that belong to no frame."""
        return self._stream.skipped

    def drain(self, *, stalled: bool = False) -> Iterable[ClassifiedFrames]:
        """Return everything complete: one ClassifiedFrames, or one for each datagram if not all are full of frames.

        Each is valid until the next.
        """
        if not self._datagrams:
            return (self._classified(self._stream.drain(stalled=stalled)),)
        waiting, self._waiting = self._waiting, []
        full = self._stream.drain_full(waiting) if len(waiting) > 1 else None
        return self._each(waiting) if full is None else (self._classified(full),)

    def _each(self, waiting: Iterable[tuple[bytes, int]]) -> Iterator[ClassifiedFrames]:
        for data, arrival_ns in waiting:
            self._stream.feed(data, arrival_ns)
            yield self._classified(self._stream.drain(stalled=True))

    def _classified(self, whole: Whole) -> ClassifiedFrames:
        """Drop the frames that are old by their sequence number."""
        cut = cast(ClassifiedFrames, whole)  # as passed to the parser
        table, arrivals, rejects = cut.table, cut.arrival_ns, cut.rejects
        judged = cut.verdict = self.sequences.classify(cut.array, table, arrivals)
        refused = self._intact(cut, rejects) if rejects else []
        if judged.dropped:
            refused += self._old(cut, table, arrivals, judged, rejects)
            rejects.sort(key=attrgetter("offset"))
        if refused or (judged.gaps and self._refused):
            self._correct_losses(cut, table, judged, sorted(refused))
        if judged.dropped:
            good = judged.rows[LOST] >= 0
            cut.table, cut.arrival_ns = np.ascontiguousarray(table[:, good]), arrivals[good]
            rows: Any = np.ascontiguousarray(judged.rows[:, good])
            cut.verdict = ReplayVerdict(rows, judged.dropped, judged.gaps, judged.other, judged.mixed)
        return cut

    def _old(
        self, whole: Whole, table: Ints, arrivals: Ints, judged: ReplayVerdict, rejects: list[RejectedFrame]
    ) -> list[tuple[int, int, int]]:
        """Reject the frames whose number is old: position, device and number of each."""
        lost, refused = judged.rows[LOST], []
        for i in np.flatnonzero(lost < 0).tolist():
            at, size = int(table[OFFSET, i]), int(table[SIZE, i])
            sender, mode = int(table[SENDER, i]), whole.data[at + MODE_AT]
            number = int.from_bytes(whole.data[at + SEQUENCE_AT : at + SEQUENCE_AT + 4], "little")
            detail = f"number {number} after {self.sequences.last_of(sender, mode)}"
            reason = REASONS[-lost[i]]
            rejects.append(RejectedFrame(whole.start + at, size, reason, int(arrivals[i]), str(sender), detail))
            refused.append((at, sender, number))
        return refused

    def _intact(self, whole: Whole, rejects: list[RejectedFrame]) -> list[tuple[int, int, int]]:
        """Device and number of intact frames that a setting refuses, so that they are not counted as lost."""
        refused = []
        for i, reject in enumerate(rejects):
            if reject.reason not in INTACT:
                continue
            at = reject.offset - whole.start
            header = whole.data[at : at + DEVICE_AT + 2]
            sender = int.from_bytes(header[DEVICE_AT:], "little")
            refused.append((at, sender, int.from_bytes(header[SEQUENCE_AT : SEQUENCE_AT + 4], "little")))
            rejects[i] = replace(reject, device=str(sender))
        return refused

    def _record(self, sender: int, number: int) -> None:
        if sender in self._refused or len(self._refused) < REFUSED_DEVICES:
            self._refused.setdefault(sender, deque(maxlen=REFUSED_NUMBERS)).append(number)

    def _correct_losses(
        self, whole: Whole, table: Ints, judged: ReplayVerdict, refused: list[tuple[int, int, int]]
    ) -> None:
        """Exclude from the losses the frames that were refused before a gap was seen.

        Only those before: the number of frames drained at once must not matter.
        """
        coming = deque(refused)
        for i in np.flatnonzero(judged.rows[LOST] > 0).tolist():
            at, missing = int(table[OFFSET, i]), int(judged.rows[LOST, i])
            while coming and coming[0][0] < at:
                self._record(*coming.popleft()[1:])
            known = self._refused.get(int(table[SENDER, i]))
            if not known:
                continue
            number = int.from_bytes(whole.data[at + SEQUENCE_AT : at + SEQUENCE_AT + 4], "little")
            between = sum(0 < (number - one) & MASK <= missing for one in set(known))
            judged.rows[LOST, i] = missing - between
            if missing - between == 0 and not judged.rows[TAKEN_BACK, i]:
                judged.gaps -= 1
        for _, sender, number in coming:
            self._record(sender, number)
