"""What a simulated cable does: nothing when it is good, and each fault as its name says."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.idtp.frames import build as idtp_build
from protocols.isb.frames import build as isb_build
from server.links.cable import Cable, Faults, frames_of
from server.links.uart import as_heard
from tests.links.bench import frame, xbus

FRAMES = [frame(i, i * 100) for i in range(200)]
FOREVER = 10**18


@given(st.lists(st.one_of(st.binary(max_size=12), st.binary(max_size=300).map(lambda data: xbus(0x36, data[:254])))))
def test_cutting_loses_nothing(pieces: list[bytes]) -> None:
    data = b"".join(pieces)
    cut, rest = frames_of(data)
    assert b"".join(cut) + rest == data


def test_frames_are_cut_at_frames() -> None:
    long = b"\xfa\xff\x36\xff\x01\x00" + bytes(256) + b"\x00"
    cut, rest = frames_of(b"junk" + FRAMES[0] + long + FRAMES[1] + FRAMES[2][:5])
    assert cut == [b"junk", FRAMES[0], long, FRAMES[1]]
    assert rest == FRAMES[2][:5]


@given(st.binary(max_size=200), st.integers(1, 7))
def test_a_good_cable_changes_nothing(noise: bytes, step: int) -> None:
    cable = Cable(Faults())
    data = noise + b"".join(FRAMES[:5])
    heard = b""
    for at in range(0, len(data), step):
        cable.send(data[at : at + step], at)
        heard += cable.arrived(FOREVER)
    assert data.startswith(heard)
    assert len(data) - len(heard) <= len(noise) + len(b"".join(FRAMES[:5]))


def test_drop_loses_whole_frames_in_the_given_share() -> None:
    cable = Cable(Faults(drop=0.3), seed=1)
    cable.send(b"".join(FRAMES), 0)
    kept, rest = frames_of(cable.arrived(FOREVER))
    assert rest == b""
    assert set(kept) <= set(FRAMES)
    assert 0.55 * len(FRAMES) < len(kept) < 0.85 * len(FRAMES)


def test_corrupt_flips_one_bit_of_the_given_share() -> None:
    cable = Cable(Faults(corrupt=0.3), seed=1)
    cable.send(b"".join(FRAMES), 0)
    heard = cable.arrived(FOREVER)
    sent = b"".join(FRAMES)
    assert len(heard) == len(sent)
    flips = [(a ^ b).bit_count() for a, b in zip(sent, heard, strict=True)]
    assert max(flips) == 1
    assert 0.15 * len(FRAMES) < sum(flips) < 0.45 * len(FRAMES)


def test_the_same_seed_makes_the_same_faults() -> None:
    heard = []
    for _ in range(2):
        cable = Cable(Faults(drop=0.1, corrupt=0.1), seed=7)
        cable.send(b"".join(FRAMES), 0)
        heard.append(cable.arrived(FOREVER))
    assert heard[0] == heard[1]


def test_bytes_take_their_time_on_the_line() -> None:
    cable = Cable(Faults(baud=10_000))  # 1 byte/ms
    cable.send(FRAMES[0] + FRAMES[1], 0)
    size = len(FRAMES[0])
    assert cable.next_ns == size * 1_000_000
    assert cable.arrived(size * 1_000_000 - 1) == b""
    assert cable.arrived(size * 1_000_000) == FRAMES[0]
    assert cable.arrived(2 * size * 1_000_000) == FRAMES[1]
    assert cable.next_ns is None


def test_a_line_that_is_too_slow_overflows_and_counts() -> None:
    cable = Cable(Faults(baud=10_000))
    cable.send(b"".join(FRAMES), 0)
    heard = cable.arrived(FOREVER)
    assert len(heard) + cable.overflowed == sum(map(len, FRAMES))
    assert 400 < len(heard) < 700  # about half a second of it


def test_bursts_come_when_the_adapter_lets_go() -> None:
    cable = Cable(Faults(burst_ms=16))
    for ms in range(20):
        cable.send(FRAMES[ms], ms * 1_000_000)
    assert cable.arrived(15_999_999) == FRAMES[0]
    assert cable.arrived(16_000_000) == b"".join(FRAMES[1:17])
    assert cable.arrived(32_000_000) == b"".join(FRAMES[17:20])


@pytest.mark.parametrize("baud", [4800, 9600, 115_200, 921_600])
def test_the_right_rate_hears_what_was_sent(baud: int) -> None:
    data = bytes(range(256))
    assert as_heard(data, baud, baud) == data
    assert as_heard(data, baud, round(baud * 1.02)) == data  # receivers stand two percent
    assert as_heard(data, baud, round(baud * 0.98)) == data


@pytest.mark.parametrize(("sent", "heard"), [(115_200, 9600), (115_200, 921_600), (57_600, 115_200), (115_200, 57_600)])
def test_a_wrong_rate_hears_noise_in_the_amount_that_a_receiver_would(sent: int, heard: int) -> None:
    data = random.Random(0).randbytes(1000)
    noise = as_heard(data, sent, heard)
    assert noise
    assert noise != data
    assert len(noise) <= len(data) * heard / sent * 10 / 9.5 + 1  # a byte is over in the middle of its stop bit
    if heard * 4 < sent:
        assert len(noise) < len(data)


@given(st.binary(max_size=60), st.integers(1, 4_000_000), st.integers(1, 4_000_000))
def test_any_pair_of_rates_ends(data: bytes, sent: int, heard: int) -> None:
    assert len(as_heard(data, sent, heard)) <= 10 * len(data) + 1


@pytest.mark.parametrize(
    ("protocol", "frames"),
    [
        ("isb", [isb_build(4, 58, bytes(36)), isb_build(8), isb_build(5, 12, bytes(4), offset=16)]),
        ("idtp", [idtp_build(4, bytes(36), mode=mode, key=b"k") for mode in range(3)]),
    ],
)
def test_frames_of_other_families_are_cut_wherever_the_bytes_are(protocol: str, frames: list[bytes]) -> None:
    data = b"noise" + b"".join(frames)
    assert frames_of(data, protocol) == ([b"noise", *frames], b"")
    for cut in range(len(data)):
        pieces, rest = frames_of(data[:cut], protocol)
        more, end = frames_of(rest + data[cut:], protocol)
        assert b"".join(pieces + more) == data
        assert end == b""
        assert (pieces + more)[-len(frames) :] == frames


def test_a_rate_that_the_line_cannot_carry_is_noise_at_both_ends() -> None:
    """Host and device agree on the rate, and still nothing can be read."""
    cable = Cable(Faults(baud=921_600, dead_baud=921_600))
    sent = b"".join(FRAMES[:20])
    cable.send(sent, 0)
    heard = cable.arrived(FOREVER, 921_600)
    assert heard
    assert not any(one in heard for one in FRAMES[:20])
    cable.baud = 115_200
    cable.send(sent, FOREVER)
    assert cable.arrived(2 * FOREVER, 115_200) == sent


def test_what_is_under_way_keeps_the_rate_at_which_it_was_sent() -> None:
    """The acknowledgement of a reset is still read at the old rate, although the device has gone to the new one."""
    cable = Cable(Faults(baud=115_200))
    cable.send(FRAMES[0], 0)
    cable.baud = 921_600
    cable.send(FRAMES[1], 1)
    assert cable.arrived(FOREVER, 115_200).startswith(FRAMES[0])
