"""Events for clients that connect later, including all that are drawn over samples."""

from __future__ import annotations

from imuscope.server.streaming.event_log import CHANGES_RESENT, EVENTS_PER_MESSAGE, MAX_MARKS, EventLog
from imuscope.server.wire import EventInfo, EventKind


def event(seq: int, kind: EventKind, *, device: str = "1", time: float | None = None) -> EventInfo:
    when = float(seq) if time is None else time
    span = (when - 0.1, when) if kind == "gap" else (None, None)
    return EventInfo(seq, when, device, kind, "error", "", *span, 1, {})


def events_of(log: EventLog) -> list[EventInfo]:
    return [one for piece in log.for_late() for one in piece]


def test_an_outage_is_reported_however_much_happened_since() -> None:
    """Regression: gaps of some minutes ago had no hatch after a page load, because a thousand replies had been logged
    since.
    """
    log = EventLog(history_s=600.0)
    log.append(event(0, "gap"))
    log.append(event(1, "clock"))
    for seq in range(2, 9000):
        log.append(event(seq, "reply", time=2.0))
    results = events_of(log)
    assert [one.seq for one in results[:2]] == [0, 1]
    assert len(results) == 2 + CHANGES_RESENT


def test_a_bad_line_does_not_push_out_the_losses_of_another_device() -> None:
    log = EventLog(history_s=600.0)
    log.append(event(0, "gap", device="2"))
    for seq in range(1, MAX_MARKS + 500):
        log.append(event(seq, "gap", time=1.0))
    results = events_of(log)
    assert results[0].device == "2"
    assert sum(one.device == "1" for one in results) == MAX_MARKS


def test_marks_go_with_their_samples_and_their_device() -> None:
    log = EventLog(history_s=600.0)
    for seq, device in enumerate("1122"):
        log.append(event(seq, "gap", device=device, time=1000.0 * (seq % 2)))
    log.trim({}, 700.0)
    assert [one.seq for one in events_of(log)] == [1, 3]
    log.forget("2")
    assert [one.seq for one in log] == [1]


def test_marks_of_a_source_that_ended_stay_as_long_as_its_samples() -> None:
    log = EventLog(history_s=600.0)
    for seq, device in enumerate("12"):
        log.append(event(seq, "gap", device=device, time=100.0))
    log.trim({"1": 110.0, "2": 5000.0}, 5000.0)
    assert [one.device for one in events_of(log)] == ["1"]


def test_it_is_sent_in_order_in_pieces() -> None:
    log = EventLog(history_s=600.0)
    for seq in range(2000):
        log.append(event(seq, "gap" if seq % 2 else "reply", device=str(seq % 3)))
    pieces = list(log.for_late())
    assert max(len(piece) for piece in pieces) == EVENTS_PER_MESSAGE
    numbers = [one.seq for one in events_of(log)]
    assert numbers == sorted(numbers)
