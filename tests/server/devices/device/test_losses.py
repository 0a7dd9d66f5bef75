"""Losses of a session: what was lost, why, and what was not."""

import struct
from collections.abc import Callable
from itertools import islice

import pytest

from imuscope.protocols.idtp.frames import build as idtp_frame
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server import wire
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.device.losses import LossWindow
from tests.server.devices.family_harness import family
from tests.support.each_row import each_row
from tests.support.truth_frames import xbus


@each_row(
    ("request", "answered", "words"),
    [
        (build(0x8E, bytes.fromhex("00080005")), "8F", "switched to string output"),
        (b"", "", "config state"),
        (build(0x2C, bytes([8, 6, 1]) + bytes(9)), "2D", "on request only"),
    ],
)
async def test_samples_that_a_device_left_out_on_request_are_not_blamed_on_the_cable(
    request: bytes, answered: str, words: str
) -> None:
    """String output for 20 s was reported as 104 samples lost in the device, the adapter or the cable."""

    class Counting:
        """An MTi whose counter goes on while it sends no samples, as it may."""

        next_ns = 0

        def __init__(self) -> None:
            self.frames = iter(
                [
                    sample(1),
                    sample(2),
                    build(0x31, b""),
                    *([build(int(answered, 16), request[4:-1])] if answered else []),
                    build(0x11, b""),
                    sample(50),
                    sample(51),
                    sample(53),
                ]
            )

        def advance(self, now_ns: int) -> bytes:
            return next(self.frames, b"")

    def sample(number: int) -> bytes:
        return build(0x36, bytes.fromhex("102002") + number.to_bytes(2, "big") + bytes.fromhex("081004") + bytes(4))

    async with family(DecodeOptions()) as stage:
        await stage.run(Counting(), 2)
        first, second = stage.events("gap")
        assert (first.samples, first.level, first.data["by"]) == (47, "info", "request")
        assert words in first.text
        assert second.data["by"] == ("request" if "request" in words else "unknown")


async def test_samples_lost_by_a_false_number_only_are_taken_back() -> None:
    """One damaged sequence number counted 60 000 samples as lost, for good."""

    class Damaged:
        next_ns = 0

        def __init__(self) -> None:
            numbers = [*range(10, 15), 60_010, *range(15, 25)]
            self.frames = iter([idtp_frame(0, bytes(12), sequence=n, timestamp=1000 * n) for n in numbers])

        def advance(self, now_ns: int) -> bytes:
            return next(self.frames, b"")

    async with family(DecodeOptions()) as stage:
        device = Damaged()
        await stage.run(device, 0.6)
        assert (stage.health.lost, stage.health.gaps) == (59_995, 1)
        await stage.run(device, 2)
        assert (stage.health.lost, stage.health.gaps) == (0, 0)
        [report] = [event for event in stage.events("device") if "withdrawn" in event.data]
        assert report.text.startswith("59995 samples reported as lost earlier were not lost")


async def test_bytes_that_no_decoder_claims_are_counted() -> None:
    """What looks like no frame vanished without a trace."""

    class Port:
        next_ns = 0

        def __init__(self) -> None:
            self.device = XbusSimulator()

        def advance(self, now_ns: int) -> bytes:
            return self.device.advance(now_ns) + b"\x05" * 7

    async with family(DecodeOptions()) as stage:
        await stage.run(Port(), 2)
        assert stage.health.unclaimed == 20 * 7


class Lossy:
    """Frames of several messages that share a counter; each tenth frame is lost. Four messages take turns."""

    next_ns = 0

    def __init__(self, frames: Callable[[int], bytes], number: int = 4000) -> None:
        self.numbers = iter(range(number))
        self.frame = frames

    def advance(self, now_ns: int) -> bytes:
        return b"".join(self.frame(n) for n in islice(self.numbers, 40) if n % 10 != 5)


def idtp_of_four(n: int) -> bytes:
    return idtp_frame((0x00, 0x01, 0x02, 0x04)[n % 4], bytes((12, 24, 24, 16)[n % 4]), sequence=n, timestamp=1000 * n)


def xbus_of_two(n: int) -> bytes:
    """An MTi that sends orientation in each fourth frame, and a sentence beside each frame, which has no number."""
    body = bytes.fromhex("102002") + (n % 65536).to_bytes(2, "big")
    body += bytes.fromhex("402010") + bytes(12) + b"\0\0\0\0" if n % 4 == 0 else bytes.fromhex("081004") + bytes(4)
    return build(0x36, body) + b"$HCHDM,354.0,M*23\r\n"


@each_row("frames", [idtp_of_four, xbus_of_two])
async def test_the_share_of_loss_is_that_of_all_messages_that_share_the_counter(
    frames: Callable[[int], bytes],
) -> None:
    """Regression: four messages with one counter had four times the share, in alarms and in the fleet."""
    window = LossWindow(60.0)
    async with family(DecodeOptions()) as stage:
        device = Lossy(frames)
        await stage.run(device, 1)
        window.add(stage.health)
        await stage.run(device, 8)
        window.add(stage.health)
        assert stage.health.lost > 200
        assert window.share == pytest.approx(0.1, rel=0.02)


def test_fewer_samples_are_those_of_another_session() -> None:
    def health(time: float, lost: int, numbered: int) -> wire.DeviceHealth:
        counts = (0.0, [], 0, lost, 0, 0, 0.0, None, None, None, None, None)
        return wire.DeviceHealth("1", time, *counts, numbered=numbered)

    window = LossWindow(10.0)
    assert window.share is None
    assert window.add(health(0.0, 5, 100))
    assert window.share is None
    assert window.add(health(1.0, 15, 190))
    assert window.share == pytest.approx(0.1)
    assert not window.add(health(2.0, 0, 10))
    assert window.share is None
    assert window.add(health(3.0, 0, 20))
    assert window.share == 0.0


async def test_a_damaged_frame_with_beginnings_in_it_counts_once() -> None:
    """Regression: each beginning of a frame among the bytes of a damaged one was one more, 147 for 140."""

    class Noisy:
        """Each tenth frame is damaged; in each, bytes look like beginnings of frames."""

        next_ns = 0

        def __init__(self) -> None:
            self.number = 0

        def advance(self, now_ns: int) -> bytes:
            self.number += 10
            frames = [xbus(n, 100 * n, PRETENDING) for n in range(self.number - 10, self.number)]
            return b"".join([*frames[:4], frames[4][:-1] + b"\x01", *frames[5:]])

    async with family(DecodeOptions("xbus")) as stage:
        await stage.run(Noisy(), 5)
        assert (stage.health.rejects, stage.health.lost) == (50, 50)


PRETENDING = (0x2010, "4f", struct.unpack(">4f", bytes.fromhex("faff36053f8000faff36043f80000000")))
