"""Time, loss and patience of the Xbus decoder, and the texts between its frames."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap, Text
from imuscope.protocols.registry.families import detect
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.frames import MAX_ACCEPTED, build
from tests.protocols.decoding import decode_chunks
from tests.support.each_row import each_row

SENTENCE = b"$HCHDM,123.45,M*18\r\n"


def sample(counter: int = 0, **items: int) -> bytes:
    """An MTData2 frame with a counter and any of fine, coarse, accx."""
    payload = struct.pack(">HBH", 0x1020, 2, counter & 0xFFFF)
    if "fine" in items:
        payload += struct.pack(">HBI", 0x1060, 4, items["fine"])
    if "coarse" in items:
        payload += struct.pack(">HBI", 0x1070, 4, items["coarse"])
    return build(0x36, payload)


def utc(year: int, flags: int) -> bytes:
    return build(0x36, struct.pack(">HBIHBBBBBB", 0x1010, 12, 500_000_000, year, 1, 2, 3, 4, 5, flags))


def decode(*chunks: bytes, stalled: bool = False) -> list[Event]:
    return decode_chunks(XbusDecoder(), ((1000 * n, chunk) for n, chunk in enumerate(chunks, 1)), stalled=stalled)


def of(events: list[Event], kind: type) -> list[Event]:
    return [event for event in events if isinstance(event, kind)]


# -- time --------------------------------------------------------------------------------------------------------------


def test_fine_wraps() -> None:
    (batch,) = decode(b"".join(sample(i, fine=(2**32 - 20 + 10 * i) % 2**32) for i in range(4)))
    assert isinstance(batch, Batch)
    assert np.diff(batch.time_ns).tolist() == [1_000_000] * 3


@each_row(
    ("product", "wraps"), [("MTi-30-2A8G4", True), ("MTi-G-710-2A8G4", True), ("MTi-630-DK", False), ("MTi-3", False)]
)
def test_product_code_decides_the_wrap(product: str, wraps: bool) -> None:
    """A day on 10- and 100-series; elsewhere the same numbers are a clock that started again."""
    reply = build(0x1D, product.encode().ljust(20))
    before = sample(0, fine=864_000_000 - 10)
    events = decode(reply + before + sample(1, fine=0) + sample(2, fine=10))
    (batch,) = of(events, Batch)
    assert isinstance(batch, Batch)
    assert bool(of(events, ClockStep)) is not wraps
    if wraps:
        assert np.diff(batch.time_ns).tolist() == [1_000_000] * 2


def test_a_reply_in_the_middle_counts_from_there() -> None:
    reply = build(0x1D, b"MTi-30-2A8G4        ")
    stream = [sample(0, fine=864_000_000 - 10), reply, sample(1, fine=0)]
    whole, apart = decode(b"".join(stream)), decode(*stream)
    times = [[int(t) for b in of(events, Batch) for t in b.time_ns] for events in (whole, apart)]  # type: ignore[attr-defined]
    assert times[0] == times[1] == [86_399_999_000_000, 86_400_000_000_000]


def test_coarse_and_utc_without_fine() -> None:
    (coarse,) = decode(sample(0, coarse=5174) + sample(1, coarse=5175))
    assert coarse.message.time == "SampleTimeCoarse"  # type: ignore[union-attr]
    assert coarse.time_ns.tolist() == [5174 * 10**9, 5175 * 10**9]  # type: ignore[union-attr]
    (valid,) = decode(utc(2020, 7))
    expected = int(np.datetime64("2020-01-02T03:04:05", "s").astype(np.int64)) * 10**9 + 500_000_000
    assert valid.time_ns.tolist() == [expected]  # type: ignore[union-attr]
    (invalid,) = decode(utc(2020, 3))
    assert invalid.time_ns is None  # type: ignore[union-attr]


def test_a_better_clock_takes_over() -> None:
    """From the first message with SampleTimeFine on that is the clock; those without it then have no time."""
    events = decode(sample(0, coarse=10) + sample(1, coarse=10, fine=100_000) + sample(2, coarse=11))
    times = {int(o): b.time_ns for b in of(events, Batch) for o in b.offset}  # type: ignore[attr-defined]
    assert [None if t is None else t.tolist() for _, t in sorted(times.items())] == [[10**10], [10**10], None]
    (step,) = of(events, ClockStep)
    assert isinstance(step, ClockStep)
    assert step.kind == "sync"


# -- loss --------------------------------------------------------------------------------------------------------------


def test_gaps_are_counted_over_all_layouts() -> None:
    events = decode(sample(65534, fine=0) + sample(65535) + sample(3, fine=40) + sample(4, fine=50))
    (gap,) = of(events, SampleGap)
    assert isinstance(gap, SampleGap)
    assert (gap.missing, gap.counter, gap.time_ns) == (3, "PacketCounter", 4_000_000)


def test_restart_is_not_a_gap() -> None:
    assert not of(decode(sample(40_000) + sample(0) + sample(1)), SampleGap)


# -- patience ----------------------------------------------------------------------------------------------------------


def test_false_length_costs_time_only() -> None:
    """A stray header that claims much waits; frames behind it come when it fails, or when the link is silent."""
    false = b"\xfa\xff\x36\xff" + MAX_ACCEPTED.to_bytes(2, "big")
    frames = b"".join(sample(i) for i in range(10))
    decoder = XbusDecoder()
    decoder.feed(false + frames, 1)
    assert decoder.drain() == []
    assert decoder.buffered == len(false + frames)
    events = decoder.drain(stalled=True)
    (reject,), (batch,) = of(events, RejectedFrame), of(events, Batch)
    assert (reject.offset, reject.reason) == (0, "truncated")  # type: ignore[attr-defined]
    assert len(batch) == 10  # type: ignore[arg-type]
    assert decoder.buffered == 0
    (batch,) = of(decode(false, frames * 90, sample(9)), Batch)[:1]
    assert batch.offset[0] == len(false)  # type: ignore[attr-defined]


def test_impossible_length_does_not_wait() -> None:
    events = decode(b"\xfa\xff\x36\xff\xff\xff" + sample(1))
    assert [type(event) for event in events] == [RejectedFrame, Batch]


def test_frames_of_unknown_senders_are_skipped() -> None:
    """BID and MID both 0: no frame, although it checksums."""
    (reject,) = of(decode(build(0, b"", bid=0), sample(1)), RejectedFrame)
    assert reject.reason == "bad_id"  # type: ignore[attr-defined]


def test_any_bus_identifier() -> None:
    (reply,) = decode(build(0x31, bid=7))
    assert isinstance(reply, Reply)


def test_arrival_is_that_of_the_last_byte() -> None:
    frame = sample(1)
    (batch,) = decode(frame[:3], frame[3:] + frame)
    assert batch.arrival_ns.tolist() == [2000, 2000]  # type: ignore[union-attr]
    first, second = decode(frame, frame)
    assert (first.arrival_ns.tolist(), second.arrival_ns.tolist()) == ([1000], [2000])  # type: ignore[union-attr]


# -- items -------------------------------------------------------------------------------------------------------------


def test_bad_item_keeps_the_good_ones() -> None:
    good, tail = bytes.fromhex("1020020007E02004 00000003"), bytes.fromhex("2010103F80")
    events = decode(build(0x36, good + tail) + sample(8))
    batch, reject = of(events, Batch)[0], of(events, RejectedFrame)[0]
    assert batch.columns["PacketCounter"].tolist() == [7]  # type: ignore[attr-defined]
    assert batch.columns["StatusWord"].tolist() == [3]  # type: ignore[attr-defined]
    assert (reject.offset, reject.size, reject.reason) == (4 + len(good), 5, "bad_item")  # type: ignore[attr-defined]


def test_item_of_a_wrong_size_is_opaque() -> None:
    events = decode(build(0x36, bytes.fromhex("1020020007 20100400000000 E0200400000003")))
    (batch,), (reject,) = of(events, Batch), of(events, RejectedFrame)
    assert list(batch.columns) == ["PacketCounter", "0x2010", "StatusWord"]  # type: ignore[attr-defined]
    assert (reject.offset, reject.size) == (9, 7)  # type: ignore[attr-defined]


def test_the_last_of_a_repeated_item_counts() -> None:
    (batch,) = decode(build(0x36, bytes.fromhex("102002000B102002000C")))
    assert batch.columns["PacketCounter"].tolist() == [12]  # type: ignore[union-attr]


def test_many_layouts() -> None:
    """Three thousand layouts in one drain are three thousand batches, and quick."""
    frames = [build(0x36, struct.pack(">HB", 0x6000 + i, 1) + b"x") for i in range(3000)]
    assert len(decode(b"".join(frames))) == 3000


def test_legacy_data_are_kept() -> None:
    (reply,) = decode(build(0x32, b"\x01\x02\x03"))
    assert reply.message.name == "MTData"  # type: ignore[union-attr]
    assert reply.values == {"data": b"\x01\x02\x03"}  # type: ignore[union-attr]


def test_unknown_message_is_named_by_number() -> None:
    (reply,) = decode(build(0x7A, b"\x01"))
    assert (reply.message.name, reply.values) == ("0x7A", {"data": b"\x01"})  # type: ignore[union-attr]


# -- texts -------------------------------------------------------------------------------------------------------------


def test_sentences_between_frames() -> None:
    events = decode(sample(1) + SENTENCE[:7], SENTENCE[7:] + sample(2))
    assert [type(event) for event in events] == [Batch, Text, Batch]
    text = events[1]
    assert isinstance(text, Text)
    assert (text.name, text.offset, text.line) == ("HCHDM", len(sample(1)), SENTENCE.decode().strip())


def test_bad_sentence_is_a_reject() -> None:
    (reject,) = decode(SENTENCE.replace(b"123", b"124") + sample(1))[:1]
    assert isinstance(reject, RejectedFrame)
    assert (reject.reason, reject.size) == ("bad_checksum", len(SENTENCE))


def test_strings_alone() -> None:
    tss2 = b":12345  0000H 0123 -0456F\r\n"
    texts = of(decode(SENTENCE + tss2 + SENTENCE, stalled=True), Text)
    assert [text.name for text in texts] == ["HCHDM", "TSS2", "HCHDM"]  # type: ignore[attr-defined]


def test_skipped_bytes_are_counted() -> None:
    decoder = XbusDecoder()
    decoder.feed(b"\x01\x02\x03" + sample(1) + SENTENCE, 1)
    decoder.drain(stalled=True)
    assert decoder.skipped == 3


# -- registry ----------------------------------------------------------------------------------------------------------


def test_guess() -> None:
    frames = b"".join(sample(i) for i in range(50))
    (best, *_) = detect(frames[5:300])
    assert (best.protocol, best.score) == ("xbus", 1.0) or best.score > 0.9
    assert "Xbus frames (MTData2)" in best.reason
    assert detect(SENTENCE * 10)[0].score == pytest.approx(0.5)
    assert detect(bytes(500))[0].score == 0
    assert detect(b"")[0].score == 0


# -- GNSS messages without a fix ---------------------------------------------------------------------------------------


def solution(counter: int, fine: int, fix: int) -> bytes:
    """A GNSS solution with a counter and a clock in a separate message."""
    pvt = bytearray(94)
    pvt[20] = fix
    payload = struct.pack(">HBHHBI", 0x1020, 2, counter & 0xFFFF, 0x1060, 4, fine)
    return build(0x36, payload + struct.pack(">HB", 0x7010, 94) + bytes(pvt))


def satellites(counter: int, fine: int) -> bytes:
    payload = struct.pack(">HBHHBI", 0x1020, 2, counter & 0xFFFF, 0x1060, 4, fine)
    return build(0x36, payload + struct.pack(">HB", 0x7020, 8) + bytes(8))


@each_row("cut", ["whole", "frame by frame"])
@each_row("arbitrary", [0, 0xFFFFFFFF, 123_456_789])
def test_a_gnss_message_without_a_fix_has_no_device_time(arbitrary: int, cut: str) -> None:
    """The clock of such a message is arbitrary (MT0101P 5.3.6): no step, no time; the clock of the
    samples continues.
    """
    frames = []
    for i in range(100):
        frames.append(sample(2 * i, fine=50_000 + 100 * i))
        frames.append((solution if i % 2 else satellites)(2 * i + 1, arbitrary, *([0] if i % 2 else [])))
    events = decode(*(frames if cut != "whole" else [b"".join(frames)]))
    assert not of(events, ClockStep)
    assert not of(events, SampleGap)
    timed = [batch for batch in of(events, Batch) if batch.time_ns is not None]  # type: ignore[attr-defined]
    times = [int(time) for batch in timed for time in batch.time_ns]  # type: ignore[attr-defined]
    assert times == [100_000 * (50_000 + 100 * i) for i in range(100)]


@each_row("cut", ["whole", "frame by frame"])
def test_a_gnss_message_with_a_fix_has_its_own_older_time(cut: str) -> None:
    frames = [sample(0, fine=1000), solution(1, 7, 0), solution(2, 200, 3), satellites(3, 200), sample(4, fine=1010)]
    events = decode(*(frames if cut != "whole" else [b"".join(frames)]))
    assert not of(events, ClockStep)
    results = {
        int(offset): None if batch.time_ns is None else int(batch.time_ns[row])  # type: ignore[attr-defined]
        for batch in of(events, Batch)
        for row, offset in enumerate(batch.offset)  # type: ignore[attr-defined]
    }
    assert [results[offset] for offset in sorted(results)] == [100_000_000, None, 20_000_000, 20_000_000, 101_000_000]


@each_row("chunk", [1 << 20, 97])
def test_two_devices_on_one_line_are_two(chunk: int) -> None:
    """Two streams without a loss gave 999 gaps, 992,007 lost messages, and a clock that was reset each time."""
    items = "102002{:04x} 106004{:08x} 080402{:04x}"

    def frame(bid: int, number: int, tick: int) -> bytes:
        return build(0x36, bytes.fromhex(items.format(number, tick, number).replace(" ", "")), bid)

    data = b"".join(frame(1, k, 100 * k) + frame(2, 30_000 + k, 900_000 + 100 * k) for k in range(500))
    decoder = XbusDecoder()
    events: list[Event] = []
    for at in range(0, len(data), chunk):
        decoder.feed(data[at : at + chunk], 0)
        events += decoder.drain()
    assert not [event for event in events if isinstance(event, SampleGap | ClockStep | RejectedFrame)]
    for device, begin in (("", 0), ("2", 30_000)):
        mine = [event for event in events if isinstance(event, Batch) and event.device == device]
        numbers = np.concatenate([batch.columns["PacketCounter"] for batch in mine]).astype(np.int64)
        assert numbers.tolist() == list(range(begin, begin + 500))
        times = np.concatenate([batch.time_ns for batch in mine if batch.time_ns is not None])
        assert set(np.diff(times)) == {10_000_000}


def test_two_forms_of_one_quantity_are_two_columns() -> None:
    """Of a quantity in two coordinate systems, two number formats, or twice, only the last survived."""

    def real(identifier: int, form: str, *numbers: float) -> bytes:
        value = struct.pack(f">{len(numbers)}{form}", *numbers)
        return identifier.to_bytes(2, "big") + bytes([len(value)]) + value

    payload = real(0x2010, "f", 1, 0, 0, 0) + real(0x4020, "f", 1, 2, 3) + real(0x2014, "f", 0, 1, 0, 0)
    payload += real(0x4023, "d", 1.5, 2.5, 3.5) + real(0x0810, "f", 1) + real(0x0810, "f", 2) + real(0x0810, "f", 3)
    decoder = XbusDecoder()
    decoder.feed(build(0x36, payload) * 2, 0)
    [batch] = [event for event in decoder.drain() if isinstance(event, Batch)]
    assert {name: np.ravel(batch.columns[name][1]).tolist() for name in batch.columns} == {
        "Quaternion_ENU": [1, 0, 0, 0],
        "Acceleration_Float32": [1, 2, 3],
        "Quaternion": [0, 1, 0, 0],
        "Acceleration": [1.5, 2.5, 3.5],
        "Temperature_2": [1],
        "Temperature_3": [2],
        "Temperature": [3],
    }
    assert [field.frame for field in batch.message.fields if "Quaternion" in field.name] == [
        "ENU from body",
        "NED from body",
    ]


def test_an_undocumented_identifier_of_another_size_is_unknown_and_not_wrong() -> None:
    """0x4820 with 12 bytes was rejected, while 0x20C0 was passed over."""
    decoder = XbusDecoder()
    for identifier, wrong in (("4820", False), ("20C0", False), ("8020", True)):
        decoder.feed(build(0x36, bytes.fromhex(identifier + "0B") + bytes(11)), 0)
        events = decoder.drain()
        assert any(isinstance(event, RejectedFrame) for event in events) == wrong
