"""Parser of an Xbus stream, chunk by chunk: frames, the sentences between them, and rejects.

    bytes   [frame][frame]$GPGGA,…*hh\\r\\n[frame]··noise··[frame][fra
    ParseResult   table of the frames · Text for the sentence · Reject for each candidate that failed
    kept                                                         ^^^^ until the rest arrives

The cutting is that of every port (protocols/framing/stream_parser.py). For an MTi, two kinds of messages are searched
for between frames, NMEA sentences and binary strings, each from where its last search stopped: a sentence cut by the
end of the data waits for its rest. A string is accepted once the sentences up to its end are decided and none of them,
which have checksums, overlaps it (a TSS2 string in the words of a sentence is not a string).
"""

from bisect import bisect_right

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.embedded.nmea import STARTS
from imuscope.protocols.embedded.nmea import find_nmea as find_sentences
from imuscope.protocols.events import ParsedMessage, RejectedFrame, Text
from imuscope.protocols.framing.stream_buffer import OFFSET, SIZE
from imuscope.protocols.framing.stream_parser import ParseResult
from imuscope.protocols.framing.stream_parser import StreamParser as AnyStream
from imuscope.protocols.xbus.binary_strings import Em1000Row
from imuscope.protocols.xbus.binary_strings import find as find_strings
from imuscope.protocols.xbus.frames import scan

__all__ = ["ParseResult", "XbusStreamParser"]


class XbusStreamParser(AnyStream):
    """Cuts a stream of bytes, given in chunks, into frames, texts and rejects."""

    def __init__(self) -> None:
        super().__init__(scan, find_sentences, STARTS)
        self._nmea_at = 0  # positions in the stream: search for sentences from here …
        self._strings_at = 0  # … and for binary strings from here
        self._em1000_row = (0, 0)  # position after the last record, and how many are in its row
        self._pending: list[
            tuple[int, ParsedMessage]
        ] = []  # strings with their positions, until the sentences are decided
        self._sentences: list[tuple[int, int]] = []  # start and end of those that a later string may overlap

    def _spans(
        self, data: bytes, start: int, table: Ints, texts: list[Text], rejects: list[RejectedFrame], stalled: bool
    ) -> None:
        """Search the stretches between the frames."""
        begins = np.concatenate(([self._find_at], table[OFFSET] + table[SIZE] + start))
        stops = np.concatenate((table[OFFSET] + start, [self._scan_at]))
        for i in np.flatnonzero(begins < stops).tolist():
            final = stalled or i < table.shape[1]
            self._span(data, start, int(begins[i]), int(stops[i]), final, texts, rejects)
        last = int(begins[-1])
        self._nmea_at, self._strings_at = max(self._nmea_at, last), max(self._strings_at, last)
        self._find_at = min(self._nmea_at, self._strings_at)
        texts.sort(key=lambda text: text.offset)

    def _span(
        self,
        data: bytes,
        start: int,
        begin: int,
        stop: int,
        final: bool,
        texts: list[Text],
        rejects: list[RejectedFrame],
    ) -> None:
        self._nmea_at = at = max(begin, self._nmea_at)
        if at < stop:
            sentences, end = find_sentences(data[at - start : stop - start], final=final)
            for one in sentences:
                self._report(one, at + one.offset, texts, rejects)
            self._sentences += [(at + one.offset, at + one.offset + one.size) for one in sentences if one.name]
            self._nmea_at = at + end
        self._strings_at = at = max(begin, self._strings_at)
        if at < stop:
            sentences, end = self._find_strings(data[at - start : stop - start], at, final)
            self._pending += [(at + one.offset, one) for one in sentences]
            self._strings_at = at + end
        self._accept_pending(texts, rejects)

    def _find_strings(self, data: bytes, at: int, final: bool) -> tuple[list[ParsedMessage], int]:
        """The strings in a stretch at this position of the stream; see binary_strings.py."""
        end, count = self._em1000_row
        row = Em1000Row(end - at, count)
        result = find_strings(data, final=final, row=row)
        self._em1000_row = row.end + at, row.count
        return result

    def _accept_pending(self, texts: list[Text], rejects: list[RejectedFrame]) -> None:
        """Report the strings before which all sentences are decided, except those that a sentence covers."""
        waiting: list[tuple[int, ParsedMessage]] = []
        lasts = [last for _, last in self._sentences]  # ascending: sentences do not overlap
        for at, one in self._pending:
            end = at + one.size
            if end > self._nmea_at:
                waiting.append((at, one))
                continue
            near = bisect_right(lasts, at)  # the first sentence that ends after the start of this one
            if near == len(lasts) or self._sentences[near][0] >= end:
                self._report(one, at, texts, rejects)
        self._pending = waiting
        oldest = min((at for at, _ in waiting), default=self._strings_at)
        self._sentences = [span for span in self._sentences if span[1] > min(oldest, self._strings_at)]
