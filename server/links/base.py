"""What is a link? A place that bytes come from and go to, and nothing else.

    device ══ wire ══> Link ── Chunk(data, arrival_ns) ──> session ── decoder …
                        ^────────── write(bytes) ─────────────┘

A link does not know frames. It promises three things: every byte is delivered once and in order, each chunk carries the
host time at which it arrived, taken right after the read returned and before anything else could run, and a link that
is dead says so at once with a `LinkError` that a person can act on.

## Life of a link

    open()   connects; with `progress` every attempt is reported in words
    read()   waits, then returns everything that has arrived; raises LinkError once the link is dead and drained
    write()  sends
    close()  idempotent, also from within a failed open(); frees threads and file descriptors

A closed link may be opened again. One task reads; any task of the same event loop may write or close.

## When bytes come faster than they are read

`read` gives out about `Flow.at_once` bytes, so that whoever decodes them does a bounded piece of work and then lets
others go on. What waits is bounded by `MOST_HELD`. Beyond that a link whose sender can be held back is not read from
(`waits`: TCP, a file); of any other the oldest bytes are dropped and counted in `Flow.left_out`. `Flow.arrivals` hears
every chunk before that, in the thread that read it: a recording misses nothing that is dropped, and does not wait for
the event loop.

## Arrival time

`LinkSettings.now_ns` is the clock for arrival stamps: nanoseconds since the Unix epoch, the monotonic clock plus a wall
offset fixed once (`steady_clock`), so that a step of the wall clock never makes time run backwards within a session.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from server.listeners import CallbackList
from server.wire import Try

__all__ = ["Chunk", "ErrorKind", "Link", "LinkError", "LinkKind", "LinkSettings", "Progress", "Try", "steady_clock"]

AT_ONCE = 1 << 16
MOST_HELD = 8 << 20  # bytes that wait to be decoded: some ten seconds of the fastest serial line
CHUNK_COST = 128  # what a chunk takes in memory and in work beside its bytes

LinkKind = Literal["serial", "tcp", "tcp-listen", "udp", "file", "twin"]
ErrorKind = Literal["gone", "denied", "busy", "full", "refused", "not-found", "bad-source", "ended"]
Progress = Callable[[Try], None]


def steady_clock() -> Callable[[], int]:
    """A clock that never steps: ns since the Unix epoch, as the wall clock stood when this was called."""
    offset = time.time_ns() - time.monotonic_ns()
    return lambda: time.monotonic_ns() + offset


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes as the link gave them, and the host time (ns since the Unix epoch) at which they arrived.

    `anew`: what is played begins again with them, so that nothing before belongs with them: no clock, no counter.
    """

    data: bytes
    arrival_ns: int
    anew: bool = False


class LinkError(Exception):
    """The world did not cooperate.

    Args:
        kind: "gone" it was there and is not any more · "denied" no permission · "busy" another has it · "full" as many
            as there may be · "refused" nobody answers at that address · "not-found" there is no such port, host or
            file · "bad-source" the source is written wrongly (retrying cannot help) · "ended" a file has been played.
        message: one sentence, for a person.
        hint: what to do next, "" only where there is nothing to do.
    """

    def __init__(self, kind: ErrorKind, message: str, hint: str = "") -> None:
        super().__init__(f"{message} {hint}".rstrip())
        self.kind = kind
        self.message = message
        self.hint = hint


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """What all links of a server share.

    Args:
        now_ns: clock for arrival stamps, see the module docstring.
        connect_timeout_s: how long a TCP connection may take to be answered. 5 s: a host that is up answers in
            milliseconds, and the session retries anyway.
        sys_root: where sysfs is mounted, for the latency timer of USB adapters.
        by_id: where udev keeps the lasting names of USB adapters.
        protocol: the protocol that the user named for this source, "" for automatic; a file is played by its clock.
        key: of a twin that sends Secure frames; None for one that nobody knows.
    """

    now_ns: Callable[[], int]
    connect_timeout_s: float = 5.0
    sys_root: Path = Path("/sys")
    by_id: Path = Path("/dev/serial/by-id")
    protocol: str = ""
    key: bytes | None = field(default=None, repr=False)


@dataclass(slots=True)
class Flow:
    """How the bytes of a link are handed on, over all its connections.

    Args:
        at_once: about how many bytes `read` and `read_now` give out; whoever reads sets it.
        whole: a datagram is given out whole, however large: what it holds is framed by its end.
        arrivals: told of every chunk, in the thread that read it.
        left_out: bytes so far that were dropped because they were not read in time.
    """

    at_once: int = AT_ONCE
    whole: bool = True
    arrivals: CallbackList[[Chunk]] = field(default_factory=CallbackList)
    left_out: int = 0


class Link(ABC):
    """One link.

    Attributes:
        source: as the user gave it: "/dev/ttyUSB0", "twin:xbus".
        kind: what it is, for the page.
        capacity: bytes/s that the link can carry, None where that is not known (a network, a file).
        baud: the rate in use, None where there is none.
        notices: standing remarks for the page, each a sentence with its fix.
        flow: how its bytes are handed on.
        speed: how many times faster than by the device's clock they come: of a file that is played.
        finds_rate: `open` listens at each rate until something is understood.
    """

    kind: LinkKind
    datagrams = False  # a chunk is one: not cut where that matters (Flow.whole)

    def __init__(self, source: str, settings: LinkSettings) -> None:
        self.source = source
        self.settings = settings
        self.capacity: float | None = None
        self.baud: int | None = None
        self.notices: list[str] = []
        self.flow = Flow()
        self.speed = 1.0

    @property
    def waits(self) -> bool:
        """Its sender can be held back without losing bytes, and nobody minds."""
        return False

    @property
    def held(self) -> int:
        """Bytes that have arrived and were not read."""
        return 0

    @property
    def finds_rate(self) -> bool:
        return False

    def give_up(self, error: LinkError) -> None:
        """Have `read` end with this error, as if the link had died, where the link can: it is opened again then."""
        return

    @abstractmethod
    async def open(self, progress: Progress | None = None) -> None:
        """Connect; report each attempt to `progress`.

        Raises:
            LinkError: it cannot be opened; nothing is left open behind it.
        """

    async def relink(self, baud: int | None = None) -> None:
        """Close and open again, at another rate where one is given and the link has one.

        Raises:
            LinkError: it cannot be opened, or "refused": it has no rate that could be set at this end.
        """
        if baud is not None:
            await self.check_rate(baud)
        await self.close()
        await self.open()

    async def check_rate(self, baud: int) -> None:
        """Could this end of the link do that rate? Sets it for a moment, so bytes that arrive meanwhile may be lost.

        Raises:
            LinkError: "refused": no, in words.
        """
        hint = "Set it at the port that the device is connected to, then here as part of the source."
        raise LinkError("refused", f"The rate of {self.source} cannot be set from here.", hint)

    @abstractmethod
    async def read(self) -> list[Chunk]:
        """Wait for bytes; then what has arrived, oldest first, at least one chunk and about `flow.at_once` bytes.

        Raises:
            LinkError: the link is dead; everything that came before has been returned.
        """

    def read_now(self) -> list[Chunk]:
        """The same of what has arrived by now, without waiting; may be nothing."""
        return []

    def expect(self) -> None:  # noqa: B027 - a link that wakes its reader at once has nothing to do
        """Something was sent, and an answer may come: it must not wait."""

    @abstractmethod
    async def write(self, data: bytes) -> None:
        """Send `data` whole.

        Raises:
            LinkError: it could not be sent, or the link has no way back (a file).
        """

    @abstractmethod
    async def close(self) -> None:
        """Stop reading and free everything. Idempotent; a waiting `read` ends with LinkError "gone"."""
