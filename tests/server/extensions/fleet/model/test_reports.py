"""Reports on the bus: what is written is read, and nothing that arrives does harm."""

from __future__ import annotations

import contextlib
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.extensions.fleet.model import keys, reports
from imuscope.server.extensions.fleet.model.journal import Journal
from imuscope.server.extensions.fleet.model.reports import (
    JournalAnswer,
    ReportError,
    RobotDevice,
    RobotEvent,
    RobotReport,
    RobotStatus,
    decode_journal,
    decode_report,
    encode,
)
from tests.support.each_row import each_row

BOOT = "0123456789abcdef"
EVENT = RobotEvent(1_700_000_000.0, "link", "warning", "MTi-630 is gone.", "1")
STATUS = RobotStatus(version="1.0", devices=(RobotDevice("1", "MTi-630", "live", rate=100.0, temperature=31.5),))
REPORT = RobotReport(BOOT, 7, 1_700_000_000.0, status=STATUS, events=(EVENT,))


def packed(**changed: object) -> bytes:
    """The report as a map, with fields that another program may have written."""
    fields = msgspec.msgpack.decode(encode(REPORT))
    return msgspec.msgpack.encode({**fields, **changed})


def test_a_report_is_read_as_written() -> None:
    assert decode_report(encode(REPORT)) == REPORT
    answer = JournalAnswer(BOOT, 7, 7, (REPORT,))
    assert decode_journal(encode(answer)) == answer


def test_unknown_fields_of_a_report_are_ignored() -> None:
    assert decode_report(packed(humidity=40, status=None)).status is None


@each_row(
    "changed",
    [
        {"version": 2},
        {"boot": "../../etc"},
        {"number": -1},
        {"number": 2**60},
        {"time": math.nan},
        {"time": math.inf},
        {"events": [msgspec.to_builtins(EVENT)] * (reports.MAX_EVENTS + 1)},
        {"events": [{**msgspec.to_builtins(EVENT), "text": "x" * 501}]},
        {"status": {"devices": [{"id": "1", "name": "a", "status": "live", "temperature": math.nan}]}},
        {"status": {"devices": [{"id": "1", "name": "a", "status": "live", "loss": 1.5}]}},
        {"status": {"devices": [{"id": "1", "name": "a", "status": "live"}] * (reports.MAX_DEVICES + 1)}},
    ],
)
def test_what_exceeds_a_limit_is_refused(changed: dict[str, object]) -> None:
    with pytest.raises(ReportError):
        decode_report(packed(**changed))


def test_a_long_message_is_refused_before_it_is_read() -> None:
    with pytest.raises(ReportError, match="at most"):
        decode_report(b"\xc0" * (reports.MAX_REPORT + 1))


def test_a_journal_out_of_order_or_of_two_runs_is_refused() -> None:
    for second in (REPORT, RobotReport("f" * 16, 8, 0.0)):
        with pytest.raises(ReportError):
            decode_journal(encode(JournalAnswer(BOOT, 7, 8, (REPORT, second))))


values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats() | st.text(max_size=20) | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=20,
)
names = st.sampled_from(["boot", "number", "time", "status", "events", "devices", "version", "dropped", "reports"])


@given(st.binary(max_size=400) | st.dictionaries(names, values, max_size=8).map(msgspec.msgpack.encode))
def test_any_bytes_are_a_report_or_a_report_error(data: bytes) -> None:
    for decode in (decode_report, decode_journal):
        with contextlib.suppress(ReportError):
            assert decode(data).boot


@given(st.integers(0, len(encode(REPORT)) - 1), st.integers(0, 255))
def test_a_changed_byte_is_a_report_or_a_report_error(at: int, value: int) -> None:
    data = bytearray(encode(REPORT))
    data[at] = value
    with contextlib.suppress(ReportError):
        assert decode_report(bytes(data)).version == 1


@each_row("name", ["otter-7", "Otter 7", "a", "größe.1", "0_x"])
def test_names_of_robots(name: str) -> None:
    assert keys.is_robot_name(name)
    assert keys.robot_of(keys.report_key(name)) == name
    assert keys.parse_token(keys.token_key(name, BOOT)) == (name, BOOT)


@each_row("name", ["", "*", "**", "a/b", "a?b", "a#b", "$a", "@x", ".a", "-a", "a ", "x" * 65, "a\n", "e\u0301"])
def test_names_that_would_be_a_pattern_or_a_path_are_refused(name: str) -> None:
    assert not keys.is_robot_name(name)
    assert keys.robot_of(keys.report_key(name)) != name or not name


@given(st.text(max_size=60))
def test_any_key_is_parsed(text: str) -> None:
    for key in (text, f"{keys.ROBOTS}/{text}", keys.token_key("a", text)):
        name, boot = keys.parse_token(key)
        assert (keys.is_robot_name(name) and keys.is_boot(boot)) or (name, boot) == ("", "")


def test_a_report_without_news_has_the_number_of_the_one_before() -> None:
    journal = Journal()
    first = decode_report(journal.report(1.0, STATUS))
    second = decode_report(journal.report(2.0, None))
    assert (first.number, second.number) == (1, 1)
    assert second.is_empty
    journal.add_event(EVENT)
    third = decode_report(journal.report(3.0, None))
    assert (third.number, third.events, third.status) == (2, (EVENT,), None)


def test_the_journal_answers_with_what_is_missing() -> None:
    journal = Journal()
    for number in range(10):
        journal.report(float(number), STATUS)
    answer = decode_journal(journal.answer(journal.boot, 7))
    assert ([one.number for one in answer.reports], answer.first, answer.last) == ([8, 9, 10], 1, 10)
    assert len(decode_journal(journal.answer("f" * 16, 7)).reports) == 10  # a number of another run
    assert len(decode_journal(journal.answer(journal.boot, 0, 1)).reports) == 1  # a line with a limit advances


def test_the_journal_is_bounded_and_counts_what_was_not_taken() -> None:
    def happens(journal: Journal) -> bytes:
        journal.add_event(EVENT)
        return journal.report(0.0, None)

    size = len(happens(Journal()))
    journal = Journal(limit=4 * size + 20)
    for _ in range(6):
        happens(journal)
    assert journal.dropped == 2
    assert journal.nbytes <= 4 * size + 20
    answer = decode_journal(journal.answer(journal.boot, 6))
    assert (answer.first, answer.last, answer.reports) == (3, 6, ())
    happens(journal)
    assert journal.dropped == 2  # the oldest was taken


def test_a_flood_of_events_is_bounded_and_counted() -> None:
    journal = Journal()
    for _ in range(1100):
        journal.add_event(EVENT)
    report = decode_report(journal.report(1.0, None))
    assert len(report.events) == reports.MAX_EVENTS
    assert report.dropped == 100


def test_long_events_in_another_script_fit_into_reports() -> None:
    journal = Journal()
    for _ in range(100):
        journal.add_event(RobotEvent(1.0, "text", "warning", "観" * 500))
    count = 0
    while journal.has_events:
        count += len(decode_report(journal.report(1.0, None)).events)
    assert (count, journal.dropped) == (100, 0)


def test_a_status_that_no_one_could_read_is_left_out() -> None:
    journal = Journal()
    wrong = RobotStatus(devices=(RobotDevice("1", "MTi-630", "live", rate=math.nan),))
    report = decode_report(journal.report(1.0, wrong))
    assert (report.number, report.is_empty, report.dropped) == (0, True, 1)
    assert decode_report(journal.report(2.0, STATUS)).number == 1
