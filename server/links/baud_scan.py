"""At which rate does the device on this port speak, and what?

The port is opened once and listened to at one rate after another, most likely first. At a wrong rate a stream arrives
as noise; at the right one a protocol is recognised by its checksums, so the answer is certain and nothing needs to be
sent (a query at a wrong rate is noise to the device, and some devices take noise for a command).

    rate ──> listen 0.35 s ──┬─ recognised ──────────────> done
                             ├─ bytes, not recognised ──> a little longer, then the next rate
                             └─ nothing ────────────────> the next rate

A slow device (1 Hz) may keep silent for a whole window; when the first round heard nothing, or little, a second one
listens longer. Every try is reported in words. A pseudo-terminal has no rate: its device is recognised at the first
try.
"""

from __future__ import annotations

import asyncio
import errno
import os
import termios
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any

from server.links.base import LinkError, Progress, Try
from server.links.detection_text import DetectionResult, describe_bytes
from server.links.reader_thread import hung_up
from server.links.text import grouped

# Most likely first: the delivered settings of the three families (Xsens 115 200, Inertial Sense 921 600), then the
# rates that users choose for kHz streams, then what old and small devices speak.
RATES = (115_200, 921_600, 460_800, 2_000_000, 230_400, 57_600, 38_400, 19_200, 9_600, 1_000_000, 3_000_000, 4_800)
WINDOW_S = 0.35
LONG_WINDOW_S = 1.6  # second round: longer than the period of a 1 Hz device
ENOUGH_BYTES = 4096  # so much, and nothing recognised: it will not get better by listening longer
POLL_S = 0.02


@dataclass(frozen=True, slots=True)
class RateProbe:
    """What one rate sounded like."""

    baud: int
    heard: DetectionResult

    @property
    def attempt(self) -> Try:
        """In words, for the page."""
        return Try(what=f"{grouped(self.baud)} Bd", outcome=self.heard.words, time=time.time())


async def find_baud(port: Any, place: str, progress: Progress | None = None) -> int:
    """The rate of the device on an open port, which is left set to it.

    Args:
        port: serial.Serial, non-blocking.
        progress: told of each try.
    Raises:
        LinkError: "refused" when nothing, or nothing known, was heard at any rate.
        OSError: the port went away.
    """
    found = await scan(port, progress=progress)
    best = found[-1]
    if best.heard.recognised:
        return best.baud
    loudest = max(found, key=lambda one: one.heard.size)
    if loudest.heard.size == 0:
        raise LinkError(
            "refused",
            f"{place}: 0 B at every rate: is the device powered?",
            "Check the cable, and that the device is set to send. Any other rate is opened with ?baud=.",
        )
    raise LinkError(
        "refused",
        f"{place} sends bytes ({grouped(loudest.heard.size)} B at {grouped(loudest.baud)} Bd), but no known message at "
        f"any of {len(RATES)} rates.",
        "If you know the rate, give it with ?baud= (and bits, parity, stop if they are not 8, none, 1).",
    )


async def scan(port: Any, rates: Sequence[int] = RATES, progress: Progress | None = None) -> list[RateProbe]:
    """Listen at each rate until a protocol is recognised.

    Returns:
        Every try in order; the last one is the recognised one if any was. The port is left at that rate.
    Raises:
        OSError: the port went away.
    """
    found: list[RateProbe] = []

    async def at(baud: int, window_s: float) -> RateProbe:
        found.append(await listen_at(port, baud, window_s))
        if progress is not None:
            progress(found[-1].attempt)
        return found[-1]

    for baud in rates:
        if (await at(baud, WINDOW_S)).heard.recognised:
            return found
    loudest = max(one.heard.size for one in found)
    if loudest >= ENOUGH_BYTES:
        return found  # it talks all the time: a second round would hear the same noise
    for baud in rates:
        one = await at(baud, LONG_WINDOW_S)
        # A wrong rate makes noise, not silence: nothing at one rate for so long means nothing at any.
        if one.heard.recognised or (loudest == 0 and one.heard.size == 0):
            break
    return found


async def listen_at(
    port: Any, baud: int, window_s: float, *, sleep: Callable[[float], Awaitable[None]] = asyncio.sleep
) -> RateProbe:
    """Set a rate and listen until a protocol is recognised or the window is over (half as long again if bytes came)."""
    if port.baudrate != baud:
        try:
            port.baudrate = baud
            port.reset_input_buffer()  # what is still there was received at the last rate
        except (ValueError, OSError, termios.error) as error:
            _check_there(port.fd)
            # An adapter that cannot do a rate is no reason to give up the others.
            return RateProbe(baud, DetectionResult(note=f"not possible on this port ({error})"))
    data = bytearray()
    heard = DetectionResult()
    start = time.monotonic()
    while True:
        await sleep(POLL_S)
        fresh = _read(port.fd)
        if fresh:
            data += fresh
            heard = describe_bytes(bytes(data))
            if heard.certain:
                break
        elapsed = time.monotonic() - start
        if elapsed > window_s * (1.5 if data else 1.0) or len(data) >= ENOUGH_BYTES:
            break
    return RateProbe(baud, heard)


def _read(fd: int) -> bytes:
    try:
        data = os.read(fd, ENOUGH_BYTES)
    except BlockingIOError:
        return b""
    if not data:
        _check_there(fd)
    return data


def _check_there(fd: int) -> None:
    """OSError when the port has gone away."""
    if hung_up(fd):
        raise OSError(errno.EIO, os.strerror(errno.EIO))
