"""The stream of messages: what comes from outside never raises, is bounded, and leaves good messages whole."""

from __future__ import annotations

import math
import struct
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.events import Batch, Event, RejectedFrame, SampleGap
from imuscope.protocols.messages.decoder import MessageDecoder, reader_of
from imuscope.protocols.messages.family import MessageLister
from imuscope.protocols.messages.records import COUNTED, MESSAGE_HEAD, MessageChannel, definition, message_record
from tests.server.links import rosbags_messages as ros
from tests.support.counting import counted_calls
from tests.support.each_row import each_row

AT = 1_760_000_000 * 10**9
CHANNEL = MessageChannel(1, "/imu", "cdr", ros.IMU, "ros2msg", ros.definition(ros.IMU), {COUNTED: "publisher"})
FIX = MessageChannel(2, "/fix", "cdr", ros.FIX, "ros2msg", ros.definition(ros.FIX))
STREAM = b"".join(
    [
        *(definition(CHANNEL), definition(FIX)),
        *(message_record(1, ros.imu(n, AT + n * 10**7), sequence=n + 1, publish_ns=AT) for n in range(6)),
        *(message_record(2, ros.fix(n, AT + n * 10**7)) for n in range(3)),
        message_record(1, ros.imu(8, AT + 8 * 10**7), sequence=9),
    ]
)


def decoded(*chunks: bytes, arrival_ns: int = AT) -> list[Event]:
    decoder = MessageDecoder()
    events: list[Event] = []
    for chunk in chunks:
        decoder.feed(chunk, arrival_ns)
        events += decoder.drain()
    return events + decoder.drain(stalled=True)


def rows(events: list[Event]) -> list[tuple[str, int, str]]:
    """Every sample by its place: message, offset, values."""
    results = []
    for event in events:
        if isinstance(event, Batch):
            for row, offset in enumerate(event.offset.tolist()):
                values = {name: column[row].tolist() for name, column in event.columns.items()}
                results.append((event.message.name, offset, repr(values)))
    return sorted(results)


@given(cuts=st.lists(st.integers(0, len(STREAM)), max_size=8))
def test_any_cut_gives_the_same(cuts: list[int]) -> None:
    edges = [0, *sorted(cuts), len(STREAM)]
    pieces = [STREAM[a:b] for a, b in pairwise(edges)]
    events, whole = decoded(*pieces), decoded(STREAM)
    assert rows(events) == rows(whole)
    assert len(rows(whole)) == 10
    gaps = [event for event in events if isinstance(event, SampleGap)]
    assert [(gap.missing, gap.counter) for gap in gaps] == [(2, "/imu")]


@given(noise=st.binary(max_size=300))
def test_arbitrary_bytes_are_rejected_and_a_message_after_them_is_found(noise: bytes) -> None:
    decoder = MessageDecoder()
    decoder.feed(noise, AT)
    decoder.drain()
    decoder.drain(stalled=True)
    assert decoder.buffered == 0
    decoder.feed(STREAM, AT)
    assert len(rows(decoder.drain(stalled=True))) >= 10
    lister = MessageLister()
    lister.feed(noise + STREAM)
    lister.drain(stalled=True)


@given(changes=st.lists(st.tuples(st.integers(0, len(STREAM) - 1), st.integers(0, 255)), max_size=12))
def test_damaged_records_do_no_harm(changes: list[tuple[int, int]]) -> None:
    data = bytearray(STREAM)
    for at, value in changes:
        data[at] = value
    events = decoded(bytes(data))
    assert all(isinstance(event, Batch | RejectedFrame | SampleGap) for event in events)
    lister = MessageLister()
    lister.feed(bytes(data))
    lister.drain(stalled=True)


@each_row("size", range(0, 320, 7))
def test_a_truncated_message_is_rejected_and_counted(size: int) -> None:
    body = ros.imu(3, AT)
    assert len(body) > 320
    events = decoded(definition(CHANNEL), message_record(1, body[:size]), message_record(1, body))
    (reject,) = (event for event in events if isinstance(event, RejectedFrame))
    assert reject.reason == "bad_item"
    assert len(rows(events)) == 1


@given(text=st.text(max_size=120), body=st.binary(max_size=60))
def test_a_definition_that_lies_gives_no_numbers_or_those_of_the_bytes(text: str, body: bytes) -> None:
    channel = MessageChannel(1, "/odd", "cdr", "a/msg/B", "ros2msg", text.encode())
    decoded(definition(channel), message_record(1, b"\0\1\0\0" + body))


@each_row(
    ("text", "body"),
    [
        ("float64[] many", struct.pack("<I", 0xFFFFFFFF)),  # more elements than bytes
        ("float64[1000000000] many", b""),
        ("string text", struct.pack("<I", 0x7FFFFFFF) + b"abc"),
        ("a/C[] many\n====\nMSG: a/C\nuint8[] inner", struct.pack("<I", 5000) + bytes(20_000)),  # too many steps
        ("a/B again", bytes(64)),  # contains itself
        ("\n".join(f"a/C{n}[16] c" for n in range(9)) + "\n====\nMSG: a/C0\na/C1[16] x", bytes(64)),
    ],
)
def test_endless_arrays_end(text: str, body: bytes) -> None:
    channel = MessageChannel(1, "/odd", "cdr", "a/msg/B", "ros2msg", text.encode())
    with counted_calls() as calls:
        events = decoded(definition(channel), message_record(1, b"\0\1\0\0" + body))
    assert calls.count < 100_000  # 41,000 for the one that gives up after many steps, 600 for the others
    assert not [event for event in events if isinstance(event, Batch)]


def test_a_message_of_a_hundred_megabytes_is_skipped_over() -> None:
    channel = MessageChannel(1, "/cloud", "cdr", "a/msg/Cloud", "ros2msg", b"uint8[] data\nfloat32 last")
    body = b"\0\1\0\0" + struct.pack("<I", 100 << 20) + bytes(100 << 20) + struct.pack("<f", 2.5)
    with counted_calls() as calls:
        events = decoded(definition(channel), message_record(1, body))
    (batch,) = (event for event in events if isinstance(event, Batch))
    assert batch.columns["last"].tolist() == [2.5]
    assert calls.count < 1000  # 360 for any length


def test_a_record_that_claims_more_than_may_be_is_not_waited_for() -> None:
    decoder = MessageDecoder()
    decoder.feed(struct.pack("<BQ", 5, 1 << 40) + STREAM, AT)
    assert len(rows(decoder.drain())) == 10


def test_numbers_that_are_none_are_gaps() -> None:
    body = bytearray(ros.imu(3, AT))
    at = body.index(struct.pack("<d", 9.81))
    body[at : at + 8] = struct.pack("<d", math.nan)
    (batch,) = (one for one in decoded(definition(CHANNEL), message_record(1, bytes(body))) if isinstance(one, Batch))
    assert np.isnan(batch.columns["linear_acceleration"][0, 2])


def test_big_endian_messages_are_read() -> None:
    text = b"uint16 a\nfloat64 b\nstring s\nint32 c"
    little = struct.pack("<HxxxxxxdI3sxi", 7, 2.5, 3, b"ab\0", -4)
    big = struct.pack(">HxxxxxxdI3sxi", 7, 2.5, 3, b"ab\0", -4)
    channel = MessageChannel(1, "/x", "cdr", "a/msg/B", "ros2msg", text)
    read = reader_of(channel)
    assert read is not None
    for kind, body in ((1, little), (0, big)):
        results, refused = read([bytes([0, kind, 0, 0]) + body])
        assert not refused
        assert {name: column.tolist() for name, column in results[0].columns.items()} == {
            "a": [7],
            "b": [2.5],
            "c": [-4],
        }


def test_a_message_whose_channel_is_unknown_is_rejected() -> None:
    (reject,) = decoded(message_record(9, b"{}"))
    assert isinstance(reject, RejectedFrame)
    assert (reject.reason, reject.size) == ("bad_id", MESSAGE_HEAD.size + 2)


@each_row(("ago_s", "used"), [(0.0, True), (59.0, True), (61.0, False), (-4.0, True), (-6.0, False)])
def test_a_stamp_of_another_clock_is_not_used(ago_s: float, used: bool) -> None:
    stamp = AT - round(ago_s * 1e9)
    decoder = MessageDecoder()
    decoder.feed(definition(CHANNEL) + message_record(1, ros.imu(0, stamp)), AT)
    (batch,) = decoder.drain()
    assert isinstance(batch, Batch)
    assert (batch.time_ns is not None) == used
    assert bool(decoder.remarks) != used


def test_a_stamp_that_goes_back_waits_until_it_is_past() -> None:
    seconds = (0.0, 1.0, 2.0, 0.5, 1.5, 2.5)  # the driver's clock is set back by 1.5 s and more
    data = b"".join(message_record(1, ros.imu(n, AT + round(s * 1e9))) for n, s in enumerate(seconds))
    timed = [event for event in decoded(definition(CHANNEL) + data) if isinstance(event, Batch)]
    used = {int(t) for batch in timed if batch.time_ns is not None for t in batch.time_ns}
    assert used == {AT + round(s * 1e9) for s in (0.0, 1.0, 2.0, 1.5, 2.5)}
