"""Reports of robots that are newer than the fleet server: taken as they are, shown and counted."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.journal import Journal
from imuscope.server.extensions.fleet.model.reports import (
    MAX_MORE,
    MAX_TEXT,
    JournalAnswer,
    ReportError,
    RobotStatus,
    decode_journal,
    decode_report,
    encode,
    unknown_parts,
)
from imuscope.server.extensions.fleet.model.robots import Robots
from imuscope.server.extensions.fleet.model.summaries import FleetRobots
from imuscope.server.extensions.fleet.server.collector import Collector
from tests.support.each_row import each_row

BOOT = "0123456789abcdef"
words = st.text(min_size=1, max_size=40)
values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats() | st.text(max_size=20) | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8) | st.integers(0, 9), inner),
    max_leaves=20,
)
fields = st.dictionaries(st.from_regex(r"later_[a-z]{1,5}", fullmatch=True), values, max_size=MAX_MORE + 4)


def later_report(**changed: Any) -> dict[str, Any]:
    """A report as a later version may write it, with known words and no further fields unless given."""
    word = {"kind": "link", "level": "info", "state": "raised", "status": "live", **changed}
    more = changed.get("more", {})
    event = {"time": 1.0, "kind": word["kind"], "level": word["level"], "text": "a", **more}
    alarm = {"name": "a", "level": word["level"], "state": word["state"], **more}
    device = {"id": "1", "name": "a", "status": word["status"], **more}
    status = {"version": "9", "alarms": [alarm], "devices": [device], **more}
    return {"version": 1, "boot": BOOT, "number": 1, "time": 1.0, "status": status, "events": [event], **more}


@given(kind=words, level=words, state=words, status=words, more=fields)
def test_words_and_fields_of_later_versions_are_taken(
    kind: str, level: str, state: str, status: str, more: dict[str, Any]
) -> None:
    source = later_report(kind=kind, level=level, state=state, status=status, more=more)
    report = decode_report(msgspec.msgpack.encode(source))
    assert report.status is not None
    (event,), (alarm,), (device,) = report.events, report.status.alarms, report.status.devices
    assert (event.kind, event.level, alarm.state, device.status) == (kind, level, state, status)
    assert len(report.status.more) == len(device.more) == min(len(more), MAX_MORE)
    assert all(len(text) <= MAX_TEXT for text in device.more.values())
    journal = msgspec.msgpack.encode({"boot": BOOT, "first": 1, "last": 1, "reports": [source]})
    assert decode_journal(journal).reports == (report,)
    assert decode_journal(encode(JournalAnswer(BOOT, 1, 1, (report,)))).reports == (report,)
    stored = msgspec.msgpack.encode(report.status)  # in the database of the fleet server
    assert msgspec.msgpack.decode(stored, type=RobotStatus) == report.status


@given(words, words, fields)
def test_the_page_receives_them_as_they_are(status: str, level: str, more: dict[str, Any]) -> None:
    robots = Robots(lambda: 1_700_000_000.0)
    collector = Collector(robots, [], lambda: 1_700_000_000.0)
    collector.on_token(keys.token_key("otter", BOOT), alive=True)
    report = later_report(status=status, level=level, more=more)
    collector.on_report(keys.report_key("otter"), msgspec.msgpack.encode(report))
    (shown,) = FleetRobots.model_validate_json(robots.since(None)).robots
    assert (shown.devices[0].status, shown.alarms[0].level) == (status, level)
    assert set(shown.more) == set(shown.devices[0].more) <= set(more)
    assert collector.counts.reports == 1
    assert collector.counts.invalid == 0


def test_what_is_not_known_is_counted_once() -> None:
    report = decode_report(msgspec.msgpack.encode(later_report()))
    assert not unknown_parts(report)
    later = later_report(kind="firmware", level="critical", state="shelved", status="asleep", more={"humidity": 40})
    report = decode_report(msgspec.msgpack.encode(later))
    assert unknown_parts(report) == {"kind": 1, "level": 2, "state": 1, "status": 1, "field": 2}
    assert report.status is not None
    assert report.status.more == {"humidity": "40"}
    collector = Collector(Robots(), [])
    collector.on_token(keys.token_key("otter", BOOT), alive=True)
    collector.on_journal(keys.journal_key("otter"), encode(JournalAnswer(BOOT, 1, 0)))
    for _ in range(2):  # the second one is a repetition
        collector.on_report(keys.report_key("otter"), msgspec.msgpack.encode(later))
    assert collector.counts.unknown == unknown_parts(report)
    assert [event.kind for event in collector.batch.events] == ["firmware"]


@each_row("changed", [{"kind": ""}, {"kind": "x" * 41}, {"level": 3}, {"status": None}, {"state": ["raised"]}])
def test_a_word_of_another_shape_is_refused(changed: dict[str, Any]) -> None:
    with pytest.raises(ReportError):
        decode_report(msgspec.msgpack.encode(later_report(**changed)))


def test_a_skipped_field_that_cannot_be_read_does_not_spoil_the_report() -> None:
    data = msgspec.msgpack.encode(later_report(more={"later_text": "ab"}))
    assert data.count(b"\xa2ab") == 5
    report = decode_report(data.replace(b"\xa2ab", b"\xa2\xff\xfe"))
    assert report.status is not None
    assert report.status.more == {}


def test_a_robot_of_this_version_states_nothing_unknown() -> None:
    report = decode_report(Journal().report(1.0, RobotStatus(version="1.0")))
    assert not unknown_parts(report)
