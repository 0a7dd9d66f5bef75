"""The traffic log: entries, summaries, and limits for frequent messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Field, Message
from imuscope.protocols.xbus.frames import build
from imuscope.server.configuration.controllers import decode
from imuscope.server.configuration.traffic_log import MAX_A_SECOND, MAX_ENTRIES, TrafficLog, values_text
from imuscope.server.streaming.telemetry import Telemetry
from tests.support.fakes import FakeClock


class FakeMember:
    """The part of the interface that `decode` uses."""

    class link_session:  # noqa: N801
        class decode_options:  # noqa: N801
            @staticmethod
            def settings(names: Any) -> dict[str, Any]:
                return {}


def log(clock: FakeClock, stream: bytes = b"") -> TrafficLog:
    return TrafficLog(
        Telemetry.create(clock).bus,
        "1",
        lambda frame: decode("xbus", frame, FakeMember()),  # type: ignore[arg-type]
        PROTOCOLS["xbus"].configuration.driver.name_of,  # type: ignore[union-attr]
        lambda offset, size: stream[offset : offset + size],
    )


def reply(clock: FakeClock, name: str = "GoToConfigAck", offset: int = 0, size: int = 5) -> Reply:
    return Reply(Message(0x31, name), {}, offset, size, clock.ns)


def test_an_answer_has_its_time_since_the_request_and_its_bytes() -> None:
    clock = FakeClock()
    one = log(clock, build(0x31))
    one.sent(build(0x30))
    clock.move(0.017)
    event = reply(clock)
    one.on_received(event)
    one.matched(event)
    one.flush()
    request, answered = one.tail()
    assert (request.direction, request.name, request.hex) == ("tx", "GoToConfig", "faff3000d1")
    assert (answered.direction, answered.name, answered.hex) == ("rx", "GoToConfigAck", "faff3100d0")
    assert answered.ms is not None
    assert round(answered.ms) == 17


def test_a_request_has_the_time_at_which_it_was_written() -> None:
    clock = FakeClock()
    one = log(clock, build(0x31))
    written_ns = clock.ns
    clock.move(0.017)
    one.sent(build(0x30), written_ns=written_ns)
    event = reply(clock)
    one.on_received(event)
    one.matched(event)
    one.flush()
    request, answered = one.tail()
    assert request.time == written_ns / 1e9
    assert answered.ms is not None
    assert round(answered.ms) == 17


def test_unrequested_frames_have_no_time() -> None:
    clock = FakeClock()
    one = log(clock, build(0x31))
    one.sent(build(0x30))
    one.on_received(reply(clock))
    one.flush()
    assert one.tail()[-1].ms is None


def test_a_frame_that_is_sent_again_and_again_is_one_line() -> None:
    """GoToConfig is repeated until it is received; the restore byte is sent three thousand times a second."""
    clock = FakeClock()
    one = log(clock)
    for _ in range(1000):
        one.sent(build(0x30))
    one.sent(build(0x10))
    assert [(entry.direction, entry.name or entry.text) for entry in one.tail()] == [
        ("tx", "GoToConfig"),
        ("note", "Sent 999 more times."),
        ("tx", "GoToMeasurement"),
    ]


def test_a_talkative_device_is_limited_and_reported() -> None:
    clock = FakeClock()
    one = log(clock, build(0x31))
    for _ in range(MAX_A_SECOND + 7):
        one.on_received(reply(clock))
    one.flush()
    assert len(one.tail(limit=500)) == MAX_A_SECOND
    clock.move(1.5)
    one.on_received(reply(clock))
    one.flush()
    assert one.tail()[-2].text == "7 more messages, not listed."


def test_it_is_bounded_and_read_backwards() -> None:
    one = log(FakeClock())
    for number in range(MAX_ENTRIES + 10):
        one.add_note(str(number))
    assert len(one.tail(limit=10 * MAX_ENTRIES)) == MAX_ENTRIES
    newest = one.tail(limit=3)
    assert [entry.text for entry in newest] == [str(MAX_ENTRIES + n) for n in (7, 8, 9)]
    older = one.tail(newest[0].seq, 2)
    assert [entry.text for entry in older] == [str(MAX_ENTRIES + n) for n in (5, 6)]


def test_samples_that_were_requested_are_logged() -> None:
    clock = FakeClock()
    stream = build(0x36, bytes.fromhex("1020020001"))
    one = log(clock, stream)
    batch = Batch(Message(0x36, "MTData2"), "", np.array([clock.ns]), np.array([0]), None, {})
    one.sent(build(0x34))
    one.matched(batch)
    one.flush()
    assert (one.tail()[-1].name, one.tail()[-1].hex) == ("MTData2", stream.hex())


def test_an_error_code_is_in_words() -> None:
    fields = (Field("code", "u1", choices={4: "parameter invalid"}),)
    assert values_text({"code": 4}, fields) == "code 4 (parameter invalid)"
    assert values_text({"code": 99}, fields) == "code 99"


def test_values_are_short() -> None:
    assert values_text({"outputs": [1, 2, 3, 4, 5], "reserved": 1, "a": 1.23456789}) == "outputs: 5 entries, a 1.23457"
    assert values_text({str(n): n for n in range(9)}) == "0 0, 1 1, 2 2, 3 3 …"
    assert len(values_text({"x": "y" * 1000})) == 160
    ids = {"master_device_id": 0x0080003A, "device_id": 0x008010EC5D1D000F}
    assert values_text(ids) == "master_device_id 0080003A, device_id 8010EC5D1D000F"


def test_a_frame_of_a_client_has_the_time_at_which_it_was_sent_not_at_which_it_was_reported() -> None:
    clock = FakeClock()
    one = log(clock, build(0x31))
    sent = clock.ns / 1e9
    clock.move(0.017)
    one.on_received(reply(clock))
    clock.move(0.03)
    one.client_sent("driver (process 7)", build(0x30), {}, sent)
    times = {entry.direction: entry.time for entry in one.tail()}
    assert times["tx"] == sent < times["rx"]
