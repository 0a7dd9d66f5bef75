"""Baud rate scan of a port.

The port is opened once and listened to at one rate after another, most likely first. At a wrong rate a stream arrives
as noise; at the right one a protocol is recognised by its checksums, so the answer is certain and nothing needs to be
sent (a query at a wrong rate is noise to the device, and some devices take noise for a command).

    rate ──> listen 0.35 s ──┬─ recognised ──────────────> done
                             ├─ bytes, not recognised ──> a little longer, then the next rate
                             └─ nothing ────────────────> the next rate

A slow device (1 Hz) may be silent for a whole window, so if the first round received nothing, or little, a second one
listens longer. If some rate received many bytes, the second round covers only the silent rates: a device that starts
when its port is opened sends nothing for a second. Every attempt is reported. A pseudo-terminal has no rate: its device
is recognised at the first attempt.

A device that was stopped for a read or a write, when the server was killed, sends nothing at any rate until it gets the
frames that are owed to it (Link.owed): it is listened to at the rate at which it was left, and if it is silent there,
that is its rate.
"""

import asyncio
import errno
import os
import termios
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.links.base import Attempt, LinkError, OwedFrames, Progress, ScanWindows
from imuscope.server.links.detection_text import DetectionResult, describe_bytes
from imuscope.server.links.reader_thread import hung_up
from imuscope.server.links.text import grouped

# Tried after the factory rates: rates that users choose for kHz streams, then rates of old and small devices.
OTHER_RATES = (
    *(115_200, 921_600, 460_800, 2_000_000, 230_400, 57_600, 38_400, 19_200, 9_600, 1_000_000, 3_000_000, 4_800),
)
WINDOWS = ScanWindows()
ENOUGH_BYTES = 4096  # if nothing is recognised in so many bytes, listening longer does not help
POLL_S = 0.02


def likely_rates() -> tuple[int, ...]:
    """Rates to listen at, most likely first: factory rates of the families, then others."""
    delivered = (baud for family in PROTOCOLS.values() for baud in family.device.bauds)
    return tuple(dict.fromkeys((*delivered, *OTHER_RATES)))


@dataclass(frozen=True, slots=True)
class RateProbe:
    """Observation of one baud rate."""

    baud: int
    result: DetectionResult

    @property
    def attempt(self) -> Attempt:
        """The observation as text, for the page."""
        return Attempt(what=f"{grouped(self.baud)} Bd", outcome=self.result.words, time=time.time())


async def find_baud(
    port: Any,
    place: str,
    progress: Progress | None = None,
    windows: ScanWindows = WINDOWS,
    owed: Callable[[], OwedFrames | None] = lambda: None,
) -> int:
    """Detect the rate of the device on an open port, and leave the port at that rate.

    Args:
        port: serial.Serial, non-blocking.
        progress: called with each attempt.
        owed: frames that are owed to the device.

    Raises:
        LinkError: "refused" if no bytes, or no known protocol, were received at any rate.
        OSError: the port is gone.
    """
    if (baud := await _owed_rate(port, owed(), progress, windows)) is not None:
        return baud
    rates = likely_rates()
    probes = await scan(port, rates, progress, windows)
    best = probes[-1]
    if best.result.recognised:
        return best.baud
    loudest = max(probes, key=lambda one: one.result.size)
    if loudest.result.size == 0:
        if (baud := await _owed_rate(port, owed(), progress, windows)) is not None:
            return baud
        raise LinkError(
            "refused",
            f"{place}: 0 B at every rate: is the device powered?",
            "Check the cable, and that the device is set to send. Any other rate is opened with ?baud=.",
        )
    raise LinkError(
        "refused",
        f"{place} sends bytes ({grouped(loudest.result.size)} B at {grouped(loudest.baud)} Bd), but no known message "
        f"at any of {len(rates)} rates.",
        "If you know the rate, give it with ?baud= (and bits, parity, stop if they are not 8, none, 1).",
    )


async def _owed_rate(port: Any, owed: OwedFrames | None, progress: Progress | None, windows: ScanWindows) -> int | None:
    """The rate at which frames are owed, if the device is silent or recognised there."""
    if owed is None or owed.baud is None:
        return None
    one = await listen_at(port, owed.baud, windows.first_s)
    if progress is not None:
        progress(replace(one.attempt, outcome=f"{one.attempt.outcome}. {owed.words}"))
    return owed.baud if one.result.recognised or not one.result.size else None


async def scan(
    port: Any, rates: Sequence[int] | None = None, progress: Progress | None = None, windows: ScanWindows = WINDOWS
) -> list[RateProbe]:
    """Listen at each rate until a protocol is recognised.

    Args:
        rates: None for `likely_rates`.

    Returns:
        Every attempt in order; if a protocol was recognised, the last one is that. The port is left at that rate.

    Raises:
        OSError: the port is gone.
    """
    rates = rates or likely_rates()
    probes: list[RateProbe] = []

    async def probe(baud: int, window_s: float) -> RateProbe:
        probes.append(await listen_at(port, baud, window_s))
        if progress is not None:
            progress(probes[-1].attempt)
        return probes[-1]

    for baud in rates:
        if (await probe(baud, windows.first_s)).result.recognised:
            return probes
    loudest = max(one.result.size for one in probes)
    silent = [one.baud for one in probes if one.result.size == 0]
    # At a rate with many bytes, listening longer receives the same noise. The right rate may have been silent, because
    # a device that starts when its port is opened sends nothing for a second.
    for baud in rates if loudest < ENOUGH_BYTES else silent:
        one = await probe(baud, windows.second_s)
        # A wrong rate gives noise, not silence: no bytes at one rate for so long means no bytes at any.
        if one.result.recognised or (loudest == 0 and one.result.size == 0):
            break
    return probes


async def listen_at(port: Any, baud: int, window_s: float) -> RateProbe:
    """Set a rate and listen until a protocol is recognised or the window ends (50 % longer if bytes arrive)."""
    if port.baudrate != baud:
        try:
            port.baudrate = baud
            port.reset_input_buffer()  # its bytes were received at the previous rate
        except (ValueError, OSError, termios.error) as error:
            _check_there(port.fd)
            # The adapter may still support other rates.
            return RateProbe(baud, DetectionResult(note=f"not possible on this port ({error})"))
    data = bytearray()
    result = DetectionResult()
    start = time.monotonic()
    while True:
        await asyncio.sleep(POLL_S)
        fresh = _read(port.fd)
        if fresh:
            data += fresh
            result = describe_bytes(bytes(data))
            if result.certain:
                break
        elapsed = time.monotonic() - start
        if elapsed > window_s * (1.5 if data else 1.0) or len(data) >= ENOUGH_BYTES:
            break
    return RateProbe(baud, result)


def _read(fd: int) -> bytes:
    try:
        data = os.read(fd, ENOUGH_BYTES)
    except BlockingIOError:
        return b""
    if not data:
        _check_there(fd)
    return data


def _check_there(fd: int) -> None:
    """Raise OSError if the port is gone."""
    if hung_up(fd):
        raise OSError(errno.EIO, os.strerror(errno.EIO))
