"""What does an MTi's port carry, piece by piece? Frames, sentences between them, and what was neither.

    bytes   [frame][frame]$GPGGA,…*hh\\r\\n[frame]··noise··[frame][fra
    Cut     table of the frames · Text for the sentence · Reject for each candidate that failed
    kept                                                         ^^^^ until the rest comes

The cutting is that of every port (protocols/stream.py). An MTi's own is that two kinds are looked for between frames,
NMEA sentences and binary strings, each from where it last stopped: a sentence that is cut by the end of the data waits
for its rest, and does not hold up the strings after it.
"""

from __future__ import annotations

import numpy as np

from protocols.events import Reject, Text
from protocols.framing import OFFSET, SIZE, Ints
from protocols.nmea import Found
from protocols.nmea import find as find_sentences
from protocols.stream import Cut
from protocols.stream import Stream as AnyStream
from protocols.xbus.frames import scan
from protocols.xbus.strings import find as find_strings

__all__ = ["Cut", "Stream"]


class Stream(AnyStream):
    """Cuts a stream of bytes, given in chunks, into frames, texts and rejects."""

    def __init__(self) -> None:
        super().__init__(scan, find_sentences)
        self._nmea_at = 0  # positions in the stream: from where to look for sentences …
        self._strings_at = 0  # … and for binary strings
        self._em1000_end: int | None = None

    def _stretches(
        self, data: bytes, start: int, table: Ints, texts: list[Text], rejects: list[Reject], stalled: bool
    ) -> None:
        """Look through the stretches between the frames."""
        begins = np.concatenate(([self._find_at], table[OFFSET] + table[SIZE] + start))
        stops = np.concatenate((table[OFFSET] + start, [self._scan_at]))
        for i in np.flatnonzero(begins < stops).tolist():
            final = stalled or i < table.shape[1]
            self._stretch(data, start, int(begins[i]), int(stops[i]), final, texts, rejects)
        last = int(begins[-1])
        self._nmea_at, self._strings_at = max(self._nmea_at, last), max(self._strings_at, last)
        self._find_at = min(self._nmea_at, self._strings_at)
        texts.sort(key=lambda text: text.offset)

    def _stretch(
        self, data: bytes, start: int, begin: int, stop: int, final: bool, texts: list[Text], rejects: list[Reject]
    ) -> None:
        self._nmea_at = at = max(begin, self._nmea_at)
        if at < stop:
            found, kept = find_sentences(data[at - start : stop - start], final=final)
            self._report_all(found, at, texts, rejects)
            self._nmea_at = at + kept
        self._strings_at = at = max(begin, self._strings_at)
        if at < stop:
            since = None if self._em1000_end is None else at - self._em1000_end
            found, kept = find_strings(data[at - start : stop - start], final=final, since=since)
            self._report_all(found, at, texts, rejects)
            self._strings_at = at + kept

    def _report_all(self, found: list[Found], at: int, texts: list[Text], rejects: list[Reject]) -> None:
        for one in found:
            self._report(one, at + one.offset, texts, rejects)
            if one.name == "EM1000":
                self._em1000_end = at + one.offset + one.size
