"""The simulated line: transparent without faults, and each fault as specified."""

from __future__ import annotations

import random
import time

from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.idtp.frames import build as idtp_build
from imuscope.protocols.isb.frames import build as isb_build
from imuscope.server.links.simulated_line import FtdiPacketizer, LineFaults, SimulatedLine, frames_of, misread_at
from tests.server.links.link_fixtures import frame, xbus
from tests.support.each_row import each_row

FRAMES = [frame(i, i * 100) for i in range(200)]
FOREVER = 10**18


@given(st.lists(st.one_of(st.binary(max_size=12), st.binary(max_size=300).map(lambda data: xbus(0x36, data[:254])))))
def test_cutting_loses_nothing(pieces: list[bytes]) -> None:
    data = b"".join(pieces)
    cut, rest = frames_of(data, "xbus")
    assert b"".join(cut) + rest == data


def test_frames_are_cut_at_frames() -> None:
    long = b"\xfa\xff\x36\xff\x01\x00" + bytes(256) + b"\x00"
    cut, rest = frames_of(b"junk" + FRAMES[0] + long + FRAMES[1] + FRAMES[2][:5], "xbus")
    assert cut == [b"junk", FRAMES[0], long, FRAMES[1]]
    assert rest == FRAMES[2][:5]


@given(st.binary(max_size=200), st.integers(1, 7))
def test_a_faultless_line_changes_nothing(noise: bytes, step: int) -> None:
    cable = SimulatedLine(LineFaults(), 0, "xbus")
    data = noise + b"".join(FRAMES[:5])
    received = b""
    for at in range(0, len(data), step):
        cable.send(data[at : at + step], at)
        received += cable.arrived(FOREVER)
    assert data.startswith(received)
    assert len(data) - len(received) <= len(noise) + len(b"".join(FRAMES[:5]))


def test_drop_loses_whole_frames_in_the_given_share() -> None:
    cable = SimulatedLine(LineFaults(drop=0.3), 1, "xbus")
    cable.send(b"".join(FRAMES), 0)
    stored, rest = frames_of(cable.arrived(FOREVER), "xbus")
    assert rest == b""
    assert set(stored) <= set(FRAMES)
    assert 0.55 * len(FRAMES) < len(stored) < 0.85 * len(FRAMES)


def test_corrupt_flips_one_bit_of_the_given_share() -> None:
    cable = SimulatedLine(LineFaults(corrupt=0.3), 1, "xbus")
    cable.send(b"".join(FRAMES), 0)
    received = cable.arrived(FOREVER)
    sent = b"".join(FRAMES)
    assert len(received) == len(sent)
    flips = [(a ^ b).bit_count() for a, b in zip(sent, received, strict=True)]
    assert max(flips) == 1
    assert 0.15 * len(FRAMES) < sum(flips) < 0.45 * len(FRAMES)


def test_the_same_seed_makes_the_same_faults() -> None:
    received = []
    for _ in range(2):
        cable = SimulatedLine(LineFaults(drop=0.1, corrupt=0.1), 7, "xbus")
        cable.send(b"".join(FRAMES), 0)
        received.append(cable.arrived(FOREVER))
    assert received[0] == received[1]


def test_bytes_take_their_transmission_time() -> None:
    cable = SimulatedLine(LineFaults(baud=10_000), 0, "xbus")  # 1 byte/ms
    cable.send(FRAMES[0] + FRAMES[1], 0)
    size = len(FRAMES[0])
    assert cable.next_ns == size * 1_000_000
    assert cable.arrived(size * 1_000_000 - 1) == b""
    assert cable.arrived(size * 1_000_000) == FRAMES[0]
    assert cable.arrived(2 * size * 1_000_000) == FRAMES[1]
    assert cable.next_ns is None


def test_a_line_that_is_too_slow_overflows_and_counts() -> None:
    cable = SimulatedLine(LineFaults(baud=10_000), 0, "xbus")
    cable.send(b"".join(FRAMES), 0)
    received = cable.arrived(FOREVER)
    assert len(received) + cable.overflowed == sum(map(len, FRAMES))
    assert 400 < len(received) < 700  # about half a second of it


def test_bursts_follow_the_latency_timer() -> None:
    cable = SimulatedLine(LineFaults(burst_ms=16, packet=0), 0, "xbus")
    for ms in range(20):
        cable.send(FRAMES[ms], ms * 1_000_000)
    assert cable.arrived(15_999_999) == b""
    assert cable.arrived(16_000_000) == b"".join(FRAMES[:17])
    assert cable.arrived(31_999_999) == b""
    assert cable.arrived(32_000_000) == b"".join(FRAMES[17:20])
    assert cable.next_ns is None


def test_an_adapter_delivers_62_byte_packets_and_the_rest_at_its_timer() -> None:
    """Exact timing: 1 byte/ms, and a latency timer that restarts with each packet."""
    cable = SimulatedLine(LineFaults(baud=10_000, burst_ms=100), 0, "xbus")
    sent = FRAMES[0] + FRAMES[1] + FRAMES[2] + FRAMES[3]
    size = len(sent)
    assert 62 < size < 2 * 62
    cable.send(sent, 0)
    assert cable.next_ns == 62_000_000
    assert cable.arrived(61_999_999) == b""
    assert cable.arrived(62_000_000) == sent[:62]
    assert cable.next_ns == 162_000_000
    assert cable.arrived(161_999_999) == b""
    assert cable.arrived(162_000_000) == sent[62:]
    cable.send(FRAMES[4], 200_000_000)
    assert cable.arrived(261_999_999) == b""
    assert cable.arrived(262_000_000) == FRAMES[4]  # the timer ran on: it was started at 162 ms


@given(st.lists(st.tuples(st.integers(1, 200), st.integers(0, 40)), max_size=30), st.sampled_from([0, 62]))
def test_an_adapter_keeps_every_byte_no_longer_than_its_timer(frames: list[tuple[int, int]], packet: int) -> None:
    held, out, begin = FtdiPacketizer(16e6, packet), [], 0
    came: list[int] = []
    for size, pause_ms in frames:
        begin += pause_ms * 1_000_000
        if (gone := held.expired(begin)) is not None:
            out.append(gone)
        out += held.take(bytes(size), begin, 86_806.0)
        came += [begin + round((k + 1) * 86_806.0) for k in range(size)]
        begin += round(size * 86_806.0)
    if (gone := held.expired(FOREVER)) is not None:
        out.append(gone)
    left = [at for at, data in out for _ in data]
    assert len(left) == len(came)
    assert all(-2 <= late - at <= 16_000_002 for at, late in zip(came, left, strict=True))
    assert all(len(data) <= (packet or 1 << 30) for _, data in out)


@each_row("baud", [4800, 9600, 115_200, 921_600])
def test_the_right_rate_receives_the_sent_bytes(baud: int) -> None:
    data = bytes(range(256))
    assert misread_at(data, baud, baud) == data
    assert misread_at(data, baud, round(baud * 1.02)) == data  # receivers stand two percent
    assert misread_at(data, baud, round(baud * 0.98)) == data


@each_row(("sent", "received"), [(115_200, 9600), (115_200, 921_600), (57_600, 115_200), (115_200, 57_600)])
def test_a_wrong_rate_receives_a_realistic_amount_of_noise(sent: int, received: int) -> None:
    data = random.Random(0).randbytes(1000)
    noise = misread_at(data, sent, received)
    assert noise
    assert noise != data
    assert len(noise) <= len(data) * received / sent * 10 / 9.5 + 1  # a byte is over in the middle of its stop bit
    if received * 4 < sent:
        assert len(noise) < len(data)


@given(st.binary(max_size=60), st.integers(1, 4_000_000), st.integers(1, 4_000_000))
def test_any_pair_of_rates_ends(data: bytes, sent: int, received: int) -> None:
    assert len(misread_at(data, sent, received)) <= 10 * len(data) + 1


def test_noise_costs_time_in_proportion_to_its_bytes() -> None:
    """Regression: it cost the square of it, so a simulator that a busy host had delayed never caught up again."""
    data = random.Random(0).randbytes(32_000)

    def spent(size: int) -> float:
        """Processor time of this thread, the least of some."""
        times = []
        for _ in range(5):
            began = time.thread_time()
            misread_at(data[:size], 115_200, 921_600)
            times.append(time.thread_time() - began)
        return min(times)

    assert spent(32_000) < 64 * spent(2000)  # 16 times as much; its square would be 256 times


@each_row(
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
    """Host and device agree on the rate, but nothing is readable."""
    cable = SimulatedLine(LineFaults(baud=921_600, dead_baud=921_600), 0, "xbus")
    sent = b"".join(FRAMES[:20])
    cable.send(sent, 0)
    received = cable.arrived(FOREVER, 921_600)
    assert received
    assert not any(one in received for one in FRAMES[:20])
    cable.baud = 115_200
    cable.send(sent, FOREVER)
    assert cable.arrived(2 * FOREVER, 115_200) == sent


def test_bytes_under_way_keep_their_rate() -> None:
    """The acknowledgement of a reset arrives at the old rate, although the device has changed to the new one."""
    cable = SimulatedLine(LineFaults(baud=115_200), 0, "xbus")
    cable.send(FRAMES[0], 0)
    cable.baud = 921_600
    cable.send(FRAMES[1], 1)
    assert cable.arrived(FOREVER, 115_200).startswith(FRAMES[0])
