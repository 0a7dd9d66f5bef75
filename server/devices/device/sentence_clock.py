"""Times of NMEA sentences and UBX messages: those of the receiver, where the device has no clock of its own.

    $GNRMC,103000.10,A,…      a time: one of the clock of the receiver, mapped to host time as a device's clock is
    $GNGSA,A,3,…              none: that of the sentence before
    $GNRMC,…,010126,…         the date, which makes UTC of the times

A capture has no other arrival times than these (recordings/capture_timing.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Array, Floats, Ints
from imuscope.protocols.clocks.clock_sync import ClockSync, TimedRows
from imuscope.protocols.clocks.unix_time import NO_TIME
from imuscope.protocols.embedded.gnss_time import GnssClock
from imuscope.protocols.embedded.quantities import NmeaQuantities
from imuscope.protocols.events import Batch, Text


@dataclass(frozen=True, slots=True)
class DatedSentences:
    """Rows of one kind of sentence.

    Args:
        time_ns: (n,) host time, unix ns; NO_TIME without a clock.
        utc: (n,) unix s; None if it is not known.
    """

    batch: Batch
    time_ns: Ints
    utc: Floats | None


class SentenceRows:
    """Makes rows of the sentences of one stream.

    Args:
        sync: maps the receiver's clock to host time; None for a capture.
        by_gnss: whether the arrival times of a capture are those of the receiver.
    """

    def __init__(self, sync: ClockSync | None, by_gnss: Callable[[], bool]) -> None:
        self._quantities, self._receiver = NmeaQuantities(), GnssClock()
        self._sync, self._by_gnss = sync, by_gnss
        self._last = NO_TIME, np.nan  # of the last sentence with a time: host time and UTC

    def rows(self, texts: Sequence[Text], *, is_alone: bool) -> list[DatedSentences]:
        """Rows of some messages, in order.

        Args:
            is_alone: whether the stream has only such messages, so that no other clock is there.
        """
        batches = self._quantities.batches(texts)
        if self._sync is None:
            by_arrival = self._by_gnss()
            return [
                DatedSentences(one, one.arrival_ns if by_arrival else np.full(len(one), NO_TIME), None)
                for one in batches
            ]
        if not is_alone or not texts:
            return [DatedSentences(one, np.full(len(one), NO_TIME), None) for one in batches]
        offsets, host, utc = self._times(texts, self._sync)
        rows = []
        for batch in batches:
            at = np.searchsorted(offsets, batch.offset, "right")
            own = utc[at]
            rows.append(DatedSentences(batch, host[at], None if np.isnan(own).all() else own))
        return rows

    def _times(self, texts: Sequence[Text], sync: ClockSync) -> tuple[Array, Ints, Floats]:
        """Offsets of the messages with a time, and host time and UTC before the first and from each of them on."""
        times = self._receiver.times(texts)
        host, utc = np.array([self._last[0]]), np.array([self._last[1]])
        if len(times.offset):
            at = np.searchsorted([text.offset for text in texts], times.offset)
            arrival = np.array([text.arrival_ns for text in texts], np.int64)[at]
            [mapped] = sync.map_to_host([TimedRows(times.elapsed_ns, arrival, times.offset)])
            host = np.append(host, mapped)
            utc = np.append(utc, times.time_ns / 1e9 if times.is_dated else np.full(len(mapped), np.nan))
            self._last = int(host[-1]), float(utc[-1])
        return times.offset, host, utc
