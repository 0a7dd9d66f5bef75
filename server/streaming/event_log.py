"""Event log for clients that connect later.

There are two kinds. Events that are drawn in plots (a gap is a hatch, a clock step breaks every line, a marker is a
line) are stored for each device as long as its samples, because plots show both. Of all others, the newest are
stored.

    marks     gap, clock, marker    for history_s before the device's newest sample, at most MAX_MARKS of each device
    changes   everything else       the newest MAX_CHANGES; a new browser gets CHANGES_RESENT of them
"""

from collections import deque
from collections.abc import Iterator, Mapping

from imuscope.server.wire import EventInfo, EventKind

MARKS: frozenset[EventKind] = frozenset({"gap", "clock", "marker"})
# Ten gaps a second and their sum (server/devices/device/event_reporter.py) over ten minutes are 6600.
MAX_MARKS = 8000
MAX_CHANGES = 5000
CHANGES_RESENT = 1000
EVENTS_PER_MESSAGE = 500  # events in one message, which delays the samples behind it


class EventLog:
    """The events of a server.

    Args:
        history_s: how long samples are kept.
    """

    def __init__(self, history_s: float) -> None:
        self._history_s = history_s
        self._marks: dict[str, deque[EventInfo]] = {}
        self._changed: deque[EventInfo] = deque(maxlen=MAX_CHANGES)

    def append(self, event: EventInfo) -> None:
        """Store an event; above the maximum, the oldest of its kind is dropped."""
        if event.kind not in MARKS:
            self._changed.append(event)
            return
        marks = self._marks.setdefault(event.device, deque(maxlen=MAX_MARKS))
        marks.append(event)

    def forget(self, device: str) -> None:
        """Remove the marks of a removed device."""
        self._marks.pop(device, None)

    def trim(self, newest: Mapping[str, float], now: float) -> None:
        """Remove the marks of samples that are no longer stored.

        Args:
            newest: arrival of the newest sample of each device that has one, unix s.
            now: unix s.
        """
        earliest = min(newest.values(), default=now)  # marks of no device belong to all of them
        for device, marks in self._marks.items():
            since = newest.get(device, earliest) - self._history_s
            while marks and _end(marks[0]) < since:
                marks.popleft()

    def for_late(self) -> Iterator[list[EventInfo]]:
        """Events for a client that connects now, in order, in blocks."""
        events = [event for marks in self._marks.values() for event in marks]
        events += list(self._changed)[-CHANGES_RESENT:]
        events.sort(key=lambda event: event.seq)
        for at in range(0, max(len(events), 1), EVENTS_PER_MESSAGE):
            yield events[at : at + EVENTS_PER_MESSAGE]

    def __len__(self) -> int:
        return len(self._changed) + sum(len(marks) for marks in self._marks.values())

    def __iter__(self) -> Iterator[EventInfo]:
        """All stored events, in order."""
        events = [event for marks in self._marks.values() for event in marks]
        return iter(sorted([*events, *self._changed], key=lambda event: event.seq))


def _end(event: EventInfo) -> float:
    return event.time if event.t1 is None else max(event.time, event.t1)
