"""Losses of a session: what was lost, why, and what was not."""

from __future__ import annotations

from imuscope.protocols.idtp.frames import build as idtp_frame
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.devices.decode.decode_options import DecodeOptions
from tests.each_row import each_row
from tests.server.family_harness import family


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
        [told] = [event for event in stage.events("device") if "withdrawn" in event.data]
        assert told.text.startswith("59995 samples reported as lost earlier were not lost")


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
