"""Sequences, trust, time, devices and datagrams of IDTP."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap
from imuscope.protocols.idtp.decoder import IdtpDecoder
from imuscope.protocols.idtp.frames import LITE, SAFETY, SECURE, build
from imuscope.protocols.idtp.inspect import IdtpFrameLister, detection_score
from tests.oracles import idtp as oracle
from tests.protocols.decoding import decode_chunks
from tests.protocols.idtp.idtp_frames import with_version
from tests.protocols.idtp.idtp_vectors import KEY, everything
from tests.support.each_row import each_row

S = 1_000_000_000


def acc(sequence: int, mode: int = LITE, device: int = 7, timestamp: int = 0, key: bytes = KEY) -> bytes:
    """A frame whose acceleration encodes its sequence number."""
    payload = struct.pack("<3f", float(sequence & 0xFFFF), 0.0, 9.8)
    return build(0, payload, sequence=sequence, mode=mode, device=device, timestamp=timestamp, key=key)


def shown(events: Sequence[Event]) -> list[int]:
    """The sequence numbers (their low half) of the frames that were accepted, in the order of the stream."""
    rows: list[tuple[int, int]] = []
    for event in events:
        if isinstance(event, Batch):
            rows += zip(event.offset.tolist(), event.columns["Acceleration"][:, 0].astype(int).tolist(), strict=True)
    return [value for _, value in sorted(rows)]


def reasons(events: Sequence[Event]) -> list[str]:
    return [event.reason for event in events if isinstance(event, RejectedFrame)]


def decode(frames: Sequence[bytes | tuple[float, bytes]], **options: Any) -> list[Event]:
    """Each frame as a separate chunk; (arrival s, frame), or one per ms."""
    timed = (one if isinstance(one, tuple) else (i / 1000, one) for i, one in enumerate(frames))
    return decode_chunks(IdtpDecoder(**options), ((int(at * S), data) for at, data in timed))


# -- sequences ---------------------------------------------------------------------------------------------------------


def test_stale_frames_are_dropped_whole() -> None:
    """Nothing inside a stale frame is looked at."""
    inner = acc(50, device=9)
    stale = build(0x91, inner, sequence=3, device=7)
    events = decode([acc(5), stale, acc(6)])
    assert shown(events) == [5, 6]
    (reject,) = [event for event in events if isinstance(event, RejectedFrame)]
    assert (reject.reason, reject.size) == ("stale", len(stale))


def test_refused_frames_are_searched() -> None:
    """A candidate that fails before the sequence check hides no frame: the search continues right
    after its preamble.
    """
    inner = acc(50, device=9)
    outer = bytearray(build(0x91, inner, sequence=6, mode=SAFETY))
    outer[-1] ^= 1
    events = decode([acc(5), bytes(outer)])
    assert shown(events) == [5, 50]
    assert reasons(events) == ["bad_crc32"]


def test_devices_are_counted_separately() -> None:
    events = decode([acc(5, device=1), acc(1, device=2), acc(6, device=1), acc(1, device=2)])
    assert shown(events) == [5, 1, 6]
    assert {event.device for event in events if isinstance(event, Batch)} == {"1", "2"}


def test_a_silent_device_may_start_again() -> None:
    frames = [(0.0, acc(1000)), (0.001, acc(1001)), (3.002, acc(0)), (3.003, acc(1))]
    assert shown(decode(frames)) == [1000, 1001, 0, 1]
    assert reasons(decode([(0.0, acc(1000)), (2.9, acc(0))])) == ["stale"]


def test_no_silence_in_a_file() -> None:
    listing = IdtpFrameLister()
    listing.feed(acc(1000) + acc(0))
    assert [line.get("reject") for line in listing.drain(stalled=True)] == [None, "stale"]


def test_secure_is_rearmed_by_the_user_only() -> None:
    decoder = IdtpDecoder(key=KEY)
    decoder.feed(acc(1000, SECURE), 0)
    decoder.feed(acc(3, SECURE), 60 * S)
    assert reasons(decoder.drain()) == ["stale"]
    decoder.rearm("8")  # another device
    decoder.feed(acc(3, SECURE), 61 * S)
    assert reasons(decoder.drain()) == ["stale"]
    decoder.rearm("7")
    decoder.feed(acc(3, SECURE) + acc(4, SECURE), 62 * S)
    assert shown(decoder.drain()) == [3, 4]
    decoder.rearm()
    decoder.feed(acc(0, SECURE), 63 * S)
    assert shown(decoder.drain()) == [0]
    with pytest.raises(ValueError, match="0 to 65535"):
        decoder.rearm("70000")


def test_silence_does_not_weaken_a_secure_device() -> None:
    """A forged Lite frame cannot set the sequence number of a Secure device."""
    events = decode([(0.0, acc(1000, SECURE)), (9.0, acc(3, LITE))], key=KEY, min_mode=LITE)
    assert reasons(events) == ["stale"]


def test_weaker_frames_neither_lock_a_secure_device_out_nor_let_old_frames_in() -> None:
    """A key, and Lite accepted beside Secure: one forged Lite number made 2^16 genuine frames stale; and, after 3 s of
    silence, made a recorded Secure frame new again, shown as verified.
    """
    genuine = [(0.001 * n, acc(n, SECURE)) for n in range(5)]
    forged = (0.01, acc(60_000, LITE))
    events = decode([*genuine, forged, (0.02, acc(5, SECURE)), (0.03, acc(6, SECURE))], key=KEY, min_mode=LITE)
    assert shown(events) == [0, 1, 2, 3, 4, 60_000, 5, 6]
    assert [event.missing for event in events if isinstance(event, SampleGap)] == [60_000 - 5, 5 - 60_000]
    replay = [forged, (9.0, acc(1, LITE)), (9.1, acc(2, SECURE)), (9.2, acc(3, SECURE))]
    assert reasons(decode([*genuine, *replay], key=KEY, min_mode=LITE)) == ["stale", "stale"]


def test_one_frame_far_ahead_does_not_lock_a_device_out() -> None:
    far = 1_000_000
    assert shown(decode([acc(5), acc(far), acc(6), acc(7)])) == [5, 6, 7]
    assert reasons(decode([acc(5), acc(far), acc(6)])) == ["far_ahead"]
    assert shown(decode([acc(5), acc(far), acc(far + 1), acc(far + 2)])) == [5, (far + 1) & 0xFFFF, (far + 2) & 0xFFFF]
    assert reasons(decode([acc(5), acc(far), acc(9 * far), acc(far + 1)])) == ["far_ahead"] * 3
    assert reasons(decode([acc(5), acc(far), acc(6), acc(far + 1)])) == ["far_ahead"] * 2
    assert shown(decode([acc(5), acc(5 + 65536)])) == [5, 5]  # 2^16 is not far


def missing(events: Sequence[Event]) -> int:
    return sum(event.missing for event in events if isinstance(event, SampleGap))


def test_one_false_number_does_not_lock_a_device_out() -> None:
    """A number at most 2^16 ahead, of a damaged header or a forger, made all that followed stale until a silence."""
    for real in (LITE, SAFETY):
        good = [acc(n, real) for n in range(10, 35)]
        events = decode([*good[:5], acc(60_010, real), *good[5:]])
        assert shown(events) == [*range(10, 15), 60_010, *range(16, 35)]
        assert [reject.detail for reject in events if isinstance(reject, RejectedFrame)] == ["number 15 after 60010"]
        assert missing(events) == 0  # of 59 995 counted, all are taken back
        events = decode([*good[:5], acc(60_010, real), acc(60_011, real), *good[7:]])  # two, and two frames lost
        assert shown(events)[5:] == [60_010, 60_011, *range(19, 35)]
        assert missing(events) == 2


def test_a_real_jump_stays() -> None:
    """Frames that are late, or sent twice, are no evidence against frames that were lost."""
    late = [acc(11), acc(12), acc(20)]
    jumped = [acc(n) for n in range(100, 108)]
    events = decode([acc(10), *jumped, *late])
    assert reasons(events) == ["stale"] * 3
    assert missing(events) == 89
    again = [acc(n) for n in range(80, 108)]  # accepted before, and sent again: never new
    assert reasons(decode([*again, *again])) == ["stale"] * len(again)


def test_a_weaker_mode_never_locks_a_stronger_one_out() -> None:
    """One Lite frame made 20 of 20 Safety frames stale."""
    before, after = [acc(n, SAFETY) for n in range(10, 15)], [acc(n, SAFETY) for n in range(15, 35)]
    for forged, dropped in (([60_010], 0), ([60_010 + n for n in range(20)], 1)):
        events = decode([*before, *(acc(n, LITE) for n in forged), *after])
        assert shown(events) == [*range(10, 15), *forged, *range(15 + dropped, 35)]


def test_a_number_that_a_weaker_frame_has_is_not_a_loss() -> None:
    """Safety 345 after Lite 345, below a jump of its own mode: minus one was lost, and the frame dropped."""
    numbers = [(279, SECURE), (280, SAFETY), (312, LITE), (347, SAFETY), (343, LITE), (344, SECURE), (345, LITE)]
    events = decode([acc(number, mode) for number, mode in [*numbers, (345, SAFETY)]], key=KEY, min_mode=LITE)
    assert reasons(events) == ["stale"]
    assert shown(events)[-2:] == [345, 345]
    assert -1 not in [event.missing for event in events if isinstance(event, SampleGap)]


def test_a_late_secure_frame_makes_no_weaker_number_new() -> None:
    """Secure 50 after Lite 100 was accepted, and so were Lite 60 and 100 after it."""
    late = [acc(100, LITE), acc(50, SECURE), acc(60, LITE), acc(100, LITE)]
    assert reasons(decode(late, key=KEY, min_mode=LITE)) == ["stale"] * 3


def test_any_forged_numbers_among_good_ones() -> None:
    """Modes, losses, repetitions and forged numbers near and far in any order give the result of the oracle."""
    for seed in range(60):
        random = np.random.default_rng(seed)
        number, frames = 2**32 - 100, []
        for _ in range(200):
            number += int(random.choice([1, 1, 1, 1, 1, 1, 1, 2, 30, -3]))
            forged = (
                number + int(random.choice([200, -40, 60_000, 10**6, 17, 5, -5000]))
                if random.random() < 0.1
                else number
            )
            frames.append(acc(forged % 2**32, int(random.choice([LITE, SAFETY, SECURE] if seed % 3 else [LITE]))))
        events = decode([(0.0, b"".join(frames))], key=KEY, min_mode=LITE)
        good, bad = oracle.judge(oracle.scan(b"".join(frames), final=True, key=KEY).frames, keyed=True)
        assert sorted(int(o) for e in events if isinstance(e, Batch) for o in e.offset) == [f.offset for f, _ in good]
        assert [(e.offset, e.reason) for e in events if isinstance(e, RejectedFrame)] == bad


def test_secure_may_jump() -> None:
    events = decode([acc(5, SECURE), acc(1_000_005, SECURE)], key=KEY)
    assert [event.missing for event in events if isinstance(event, SampleGap)] == [999_999]


def test_without_replay_check() -> None:
    events = decode([acc(5), acc(4), acc(5), acc(7)], replay_check=False)
    assert shown(events) == [5, 4, 5, 7]
    assert [event.missing for event in events if isinstance(event, SampleGap)] == [1]


# -- trust -------------------------------------------------------------------------------------------------------------


def test_a_key_makes_secure_the_least() -> None:
    stream = acc(1, LITE) + acc(2, SAFETY) + acc(3, SECURE)
    assert shown(decode([stream], key=KEY)) == [3]
    assert reasons(decode([stream], key=KEY)) == ["below_min_mode"] * 2
    assert shown(decode([stream], key=KEY, min_mode=SAFETY)) == [2, 3]
    assert shown(decode([stream], min_mode=SAFETY)) == [2]


def test_a_weak_header_does_not_swallow_a_secure_frame() -> None:
    """A Lite header that claims 972 bytes is refused at once, and the frame behind it is not kept waiting."""
    header = build(0x80, bytes(972))[:20]
    decoder = IdtpDecoder(key=KEY)
    decoder.feed(header + acc(3, SECURE), 0)
    assert shown(decoder.drain()) == [3]


def test_no_key() -> None:
    events = decode([acc(1, LITE), acc(2, SECURE), acc(3, LITE)])
    assert shown(events) == [1, 3]
    assert reasons(events) == ["no_key"]


def test_unverified_frames_are_marked_and_change_no_state() -> None:
    forged = acc(60_000, SECURE, timestamp=4_000_000_000, key=b"another")
    events = decode([acc(5, timestamp=1000), forged, acc(6, timestamp=2000)], show_unverified=True)
    assert shown(events) == [5, 60_000, 6]
    assert [event.verified for event in events if isinstance(event, Batch)] == [True, False, True]
    status = [int(e.columns["Imu3AccStatus"][0]) for e in events if isinstance(e, Batch)]
    assert status == [0, 0b110, 0]
    assert not [event for event in events if isinstance(event, (SampleGap, ClockStep))]


def test_with_a_key_a_forged_frame_is_never_shown() -> None:
    events = decode([acc(5, SECURE), acc(6, SECURE, key=b"another"), acc(7, SECURE)], key=KEY, show_unverified=True)
    assert shown(events) == [5, 7]
    assert reasons(events) == ["bad_hmac"]


def test_forged_frames_among_good_ones() -> None:
    """For any mix of forged and good frames, and any contents, the result is that of the oracle."""
    random = np.random.default_rng(5)
    stream = b""
    for i in range(400):
        inner = acc(i, int(random.integers(3)))
        kind = random.integers(4)
        if kind == 0:
            stream += build(0x90, inner[: int(random.integers(60))], sequence=i, mode=SECURE, key=b"another")
        elif kind == 1:
            stream += build(0x90, inner, sequence=i, mode=SECURE, key=KEY)
        else:
            stream += inner
    for chunk in (len(stream), 333):
        events = decode([(0.0, stream[at : at + chunk]) for at in range(0, len(stream), chunk)], key=KEY, min_mode=LITE)
        result = oracle.scan(stream, final=True, key=KEY)
        good, bad = oracle.judge(result.frames, keyed=True)
        offsets = sorted(int(o) for e in events if isinstance(e, Batch) for o in e.offset)
        assert offsets == [frame.offset for frame, _ in good]
        rejects = sorted((event.offset, event.reason) for event in events if isinstance(event, RejectedFrame))
        assert rejects == sorted(result.rejects + bad)
        assert sum(e.missing for e in events if isinstance(e, SampleGap)) == sum(lost for _, lost in good)


# -- time --------------------------------------------------------------------------------------------------------------


@each_row(("unit", "ns"), [("ns", 1), ("us", 1000), ("ms", 10**6), ("s", 10**9)])
def test_timestamps_unwrap(unit: str, ns: int) -> None:
    ticks = [2**32 - 2, 2**32 - 1, 0, 1]
    events = decode([b"".join(acc(i, timestamp=t) for i, t in enumerate(ticks))], time_unit=unit)
    (batch,) = [event for event in events if isinstance(event, Batch)]
    assert batch.time_ns is not None
    assert np.diff(batch.time_ns).tolist() == [ns] * 3
    with pytest.raises(ValueError, match="time_unit is one of ns, us, ms, s"):
        IdtpDecoder(time_unit="min")


def test_a_device_that_restarts_resets_its_clock() -> None:
    events = decode([(0.0, acc(100, timestamp=90_000_000)), (4.0, acc(0, timestamp=10))])
    (step,) = [event for event in events if isinstance(event, ClockStep)]
    assert (step.kind, step.device) == ("reset", "7")


# -- versions, payloads, quaternions -----------------------------------------------------------------------------------


def warnings(events: Sequence[Event]) -> list[str]:
    return [event.values["warning"] for event in events if isinstance(event, Reply)]


def test_versions() -> None:
    events = decode([build(0, bytes(12), sequence=i, version=0x2A) for i in range(3)])
    assert warnings(events) == ["uses IDTP 2.10, newer than the supported one, and is decoded as 2.1"]
    events = decode([build(0, bytes(12), version=0x20)])
    (batch,) = [event for event in events if isinstance(event, Batch)]
    assert batch.message.name == "0x00"
    assert bytes(batch.columns["data"][0]) == bytes(12)
    assert reasons(decode([build(0, bytes(12), version=0x30)])) == ["bad_version"]


def test_successor_by_name() -> None:
    events = decode([b"INDT" + bytes(40) + acc(1) + b"INDT"])
    assert reasons(events) == ["successor"] * 2
    assert len(warnings(events)) == 1
    assert "INDT, the successor of IDTP" in warnings(events)[0]
    assert "INDT" in detection_score(b"INDT\0\0\0\0" * 20)[1]


def test_short_and_long_payloads() -> None:
    events = decode([build(4, bytes(32), sequence=1), build(4, bytes(40), sequence=2), build(4, bytes(44), sequence=3)])
    names = [event.message.name for event in events if isinstance(event, Batch)]
    assert names == ["Imu9Bytes", "Imu9", "Imu9"]
    assert len(warnings(events)) == 2
    status = [int(e.columns[f"{e.message.name}Status"][0]) for e in events if isinstance(e, Batch)]
    assert status == [0, 0x20, 0x20]


def test_rotation_setting() -> None:
    frame = build(6, struct.pack("<4f", 0.5, 0.5, -0.5, 0.5))
    for rotation, expected in (("enu_from_body", [0.5, 0.5, -0.5, 0.5]), ("body_from_enu", [0.5, -0.5, 0.5, -0.5])):
        (batch,) = decode([frame], rotation=rotation)
        assert isinstance(batch, Batch)
        assert batch.columns["Quaternion"][0].tolist() == expected
        assert batch.message.fields[0].frame == "ENU from body"
    with pytest.raises(ValueError, match="rotation is one of"):
        IdtpDecoder(rotation="inverse")  # type: ignore[arg-type]


def test_odd_quaternions_are_gaps() -> None:
    """Not normalised, not finite, a signalling NaN: marked, NaN, and no warning of numpy."""
    odd = ((1, 0, 0, 0), (2, 0, 0, 0), (3e38, 3e38, 0, 0), (0, float("inf"), 0, 0))
    payloads = [struct.pack("<4f", *q) for q in odd] + [bytes.fromhex("0100807f") + bytes(12)]
    (batch,) = decode([b"".join(build(6, p, sequence=i) for i, p in enumerate(payloads))])
    assert isinstance(batch, Batch)
    assert batch.columns["ImuQuatStatus"].tolist() == [0, 16, 16, 24, 24]
    assert np.isnan(batch.columns["Quaternion"]).all(axis=1).tolist() == [False, True, True, True, True]


# -- datagrams ---------------------------------------------------------------------------------------------------------


def test_datagrams_are_searched_separately() -> None:
    """Several frames and padding may share one; what is incomplete at its end is not continued by the next."""
    decoder = IdtpDecoder(datagrams=True)
    decoder.feed(acc(1) + acc(2) + bytes(8), 0)
    decoder.feed(acc(3)[:30], 1)
    decoder.feed(acc(3)[30:] + acc(4), 2)
    assert decoder.buffered > 0
    events = decoder.drain()
    assert shown(events) == [1, 2, 4]
    assert reasons(events) == ["truncated"]
    assert decoder.buffered == 0
    assert [a for e in events if isinstance(e, Batch) for a in e.arrival_ns.tolist()] == [0, 0, 2]


def test_datagrams_that_come_at_once_are_those_one_after_the_other() -> None:
    pieces = [acc(1) + acc(2) + bytes(8), acc(3)[:30], acc(3)[30:] + acc(4), b""]
    ends = np.cumsum([len(one) for one in pieces])
    together = IdtpDecoder(datagrams=True)
    together.feed_chunks(b"".join(pieces), ends, np.arange(len(pieces)))
    events = together.drain()
    assert shown(events) == [1, 2, 4]
    assert [a for e in events if isinstance(e, Batch) for a in e.arrival_ns.tolist()] == [0, 0, 2]


def test_datagrams_of_several_devices_make_as_few_batches_as_a_stream() -> None:
    """Regression: each datagram produced separate batches, and a slow server fell behind at 350 datagrams/s."""
    decoder = IdtpDecoder(datagrams=True)
    for number in range(40):
        decoder.feed(acc(number, device=7) + acc(number, device=8), number)
    batches = [event for event in decoder.drain() if isinstance(event, Batch)]
    assert [(batch.device, batch.arrival_ns.tolist()) for batch in batches] == [
        ("7", [*range(40)]),
        ("8", [*range(40)]),
    ]


_PIECES = st.sampled_from([acc(1), acc(2), acc(2, device=9), acc(5, device=9), acc(3)[:30], acc(3)[30:], bytes(8), b""])


@given(st.lists(st.lists(_PIECES, max_size=3).map(b"".join), max_size=8))
def test_datagrams_give_the_same_together_and_separately(datagrams: list[bytes]) -> None:
    together, apart = IdtpDecoder(datagrams=True), IdtpDecoder(datagrams=True)
    events: list[Event] = []
    for number, datagram in enumerate(datagrams):
        together.feed(datagram, number)
        apart.feed(datagram, number)
        events += apart.drain()
    assert _rows(together.drain()) == _rows(events)
    assert together.skipped == apart.skipped


def _rows(events: Sequence[Event]) -> list[object]:
    """All frame and error events in the order of the stream."""
    results: list[tuple[int, object]] = []
    for event in events:
        if isinstance(event, Batch):
            assert event.time_ns is not None
            values = zip(
                event.arrival_ns.tolist(), event.time_ns.tolist(), event.columns["Acceleration"].tolist(), strict=True
            )
            results += [
                (offset, (event.device, *one)) for offset, one in zip(event.offset.tolist(), values, strict=True)
            ]
        else:
            results.append((event.offset, repr(event)))
    return sorted(results, key=repr)


def test_detection_scores() -> None:
    frames = list(everything())
    score, why = detection_score(b"".join(frames))
    assert score == 1.0
    assert f"{len(frames)} IDTP frames" in why
    assert detection_score(bytes(100)) == (0.0, "no frame in them")


def test_another_version_is_reported_by_name() -> None:
    frames = b"".join(with_version(build(0, bytes(12), sequence=k, timestamp=k, mode=SAFETY), 0x31) for k in range(20))
    assert detection_score(frames) == (0.1, "20 frames of IDTP 3.1; this program supports IDTP 2")
    texts = [event.values["warning"] for event in decode([frames]) if isinstance(event, Reply)]
    assert texts == ["these frames are of IDTP 3.1, which is not supported"]
