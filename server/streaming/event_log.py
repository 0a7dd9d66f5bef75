"""What happened, kept for browsers that connect later.

Two kinds are kept in two ways. What is drawn over time (a gap is a hatch through every plot, a step of a clock breaks
every line, a marker is a line) belongs to the samples and is kept as long as they are, of each device by itself: an
outage of ten minutes ago is as much part of the picture as its samples. The rest is news, of which the newest are kept.

    marks   gap, clock, marker    history_s long, at most MARKS_KEPT of each device
    news    everything else       the newest NEWS_KEPT; a browser that connects is told NEWS_TO_LATE of them
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from server.wire import EventInfo, EventKind

MARKS: frozenset[EventKind] = frozenset({"gap", "clock", "marker"})
# Ten gaps a second and their sum (server/devices/event_reporter.py) over ten minutes are 6600.
MARKS_KEPT = 8000
NEWS_KEPT = 5000
NEWS_TO_LATE = 1000
AT_ONCE = 500  # in one message: samples wait behind it


class EventLog:
    """The events of a server.

    Args:
        history_s: how long samples are kept.
    """

    def __init__(self, history_s: float) -> None:
        self._history_s = history_s
        self._marks: dict[str, deque[EventInfo]] = {}
        self._news: deque[EventInfo] = deque(maxlen=NEWS_KEPT)

    def append(self, event: EventInfo) -> None:
        """Keep one; the oldest of its kind goes when there are too many."""
        if event.kind not in MARKS:
            self._news.append(event)
            return
        marks = self._marks.setdefault(event.device, deque(maxlen=MARKS_KEPT))
        marks.append(event)

    def forget(self, device: str) -> None:
        """The device was removed: its samples have gone."""
        self._marks.pop(device, None)

    def trim(self, now: float) -> None:
        """Forget the marks of samples that are no longer kept."""
        for marks in self._marks.values():
            while marks and _end(marks[0]) < now - self._history_s:
                marks.popleft()

    def for_late(self) -> Iterator[list[EventInfo]]:
        """What a browser is told that connects now, in its order, in pieces."""
        kept = [event for marks in self._marks.values() for event in marks]
        kept += list(self._news)[-NEWS_TO_LATE:]
        kept.sort(key=lambda event: event.seq)
        for at in range(0, max(len(kept), 1), AT_ONCE):
            yield kept[at : at + AT_ONCE]

    def __len__(self) -> int:
        return len(self._news) + sum(len(marks) for marks in self._marks.values())

    def __iter__(self) -> Iterator[EventInfo]:
        """All that are kept, in their order."""
        kept = [event for marks in self._marks.values() for event in marks]
        return iter(sorted([*kept, *self._news], key=lambda event: event.seq))


def _end(event: EventInfo) -> float:
    return event.time if event.t1 is None else max(event.time, event.t1)
