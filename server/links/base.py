"""Interface of a link, which receives and sends bytes.

    device ══ wire ══> Link ── Chunk(data, arrival_ns) ──> session ── decoder …
                        ^────────── write(bytes) ─────────────┘

A link is independent of frames. It guarantees three things: every byte is delivered once and in order; each chunk has
the host time of its arrival, taken right after the read returned and before anything else could run; and a link that
fails raises a `LinkError` with cause and remedy at once.

## Lifecycle

    open()   connects; with `progress` every attempt is reported as text
    read()   waits, then returns everything that has arrived; raises LinkError once the link is dead and drained
    write()  sends
    close()  idempotent, also from within a failed open(); frees threads and file descriptors

A closed link may be opened again. One task reads; any task of the same event loop may write or close.

## When bytes arrive faster than they are read

`read` returns about `Flow.at_once` bytes, which bounds the work of one decoding step. At most `MAX_HELD` bytes are
queued. Beyond that, a link whose sender can be held back is not read (`waits`: TCP, a file); for any other the oldest
bytes are dropped and counted in `Flow.dropped`. `Flow.arrivals` receives all chunks before that, in the reading
thread or in the thread that takes them first: a recording also has the dropped bytes, and does not wait for the event
loop.

## Arrival time

`LinkSettings.now_ns` is the clock for arrival stamps: nanoseconds since the Unix epoch, the monotonic clock plus a wall
offset fixed once (`steady_clock`), so that a step of the wall clock never makes time run backwards within a session.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.recordings.mcap.read_memory import NEVER_NS, ReadFollower
from imuscope.server.concurrency.listeners import CallbackList
from imuscope.server.errors import DomainError
from imuscope.server.wire import Attempt

__all__ = ["Attempt", "Chunk", "ErrorKind", "Link", "LinkError", "LinkSettings", "Progress", "steady_clock"]

READ_BYTES = 1 << 16
MAX_HELD = 8 << 20  # bytes queued for decoding: some ten seconds of the fastest serial line
CHUNK_COST = 128  # overhead of a chunk in memory and work, in bytes
SESSION_DEADLINE, RECORDING_DEADLINE = 0, 1  # positions in Flow.deadlines

ErrorKind = Literal["gone", "denied", "busy", "full", "refused", "not-found", "bad-source", "ended"]
Progress = Callable[[Attempt], None]


def steady_clock() -> Callable[[], int]:
    """A clock that never steps: ns since the Unix epoch, set by the wall clock when this was called."""
    offset = time.time_ns() - time.monotonic_ns()
    return lambda: time.monotonic_ns() + offset


@dataclass(slots=True)  # not frozen: that costs 0.5 µs each, and a device may send thousands a second
class Chunk:
    """Received bytes, and the host time (ns since the Unix epoch) at which they arrived. Read-only by convention.

    `restart`: a played file starts again with them, so that clocks and counters before do not continue.
    """

    data: bytes
    arrival_ns: int
    restart: bool = False


class LinkError(DomainError):
    """Error of a link.

    Args:
        kind: "gone" no longer available · "denied" no permission · "busy" in use · "full" maximum number reached ·
            "refused" no answer at that address · "not-found" no such port, host or file · "bad-source" invalid source
            (retrying does not help) · "ended" a file has finished.
        message: one sentence for the user.
        hint: what to do next; "" only if there is nothing to do.
    """

    kind: ErrorKind

    def __init__(self, kind: ErrorKind, message: str, hint: str = "") -> None:
        super().__init__(kind, message, hint)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class OwedFrames:
    """Frames are owed to a device that was stopped: it may be silent because of that.

    Args:
        baud: the rate at which it was left; None if its link has none.
        words: why it is silent, a sentence.
    """

    baud: int | None
    words: str


@dataclass(frozen=True, slots=True)
class ScanWindows:
    """Listening times at each rate, in the search for the rate of a device, s. Tests pass shorter ones.

    Args:
        first_s: in the first round over all rates.
        second_s: in the second round; longer than the period of a 1 Hz device.
    """

    first_s: float = 0.35
    second_s: float = 1.6


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """Settings that all links of a server share.

    Args:
        now_ns: clock for arrival stamps, see the module docstring.
        connect_timeout_s: time-out of a TCP connection. 5 s: a running host answers in milliseconds, and the session
            retries anyway.
        sys_root: mount point of sysfs, for the latency timer of USB adapters.
        by_id: folder with udev's persistent names of USB adapters.
        protocol: the protocol given by the user, "" for automatic; its clock determines the timing of a file.
        decode_options: of the source, as text: a simulator that encrypts has its key from them, else a random one.
        windows: time limits of the search for a rate.
    """

    now_ns: Callable[[], int]
    connect_timeout_s: float = 5.0
    sys_root: Path = Path("/sys")
    by_id: Path = Path("/dev/serial/by-id")
    protocol: str = ""
    decode_options: Mapping[str, str] = field(default_factory=dict, repr=False, hash=False)
    windows: ScanWindows = ScanWindows()


@dataclass(slots=True)
class Flow:
    """Byte flow of a link over all its connections.

    Args:
        at_once: approximate number of bytes that `read` and `read_now` return; set by the reader.
        keep_datagrams: a datagram is returned whole, whatever its size, because its end delimits its content.
        arrivals: called with all chunks in order, in one thread at a time.
        dropped: bytes dropped so far because they were not read in time.
        deadlines: (2,) for the session and for a recording, the time by the monotonic clock until which it will have
            taken the bytes; 0 if it is to be woken; NEVER if it needs none.
    """

    at_once: int = READ_BYTES
    keep_datagrams: bool = True
    arrivals: CallbackList[[Sequence[Chunk]]] = field(default_factory=CallbackList)
    dropped: int = 0
    deadlines: Ints = field(default_factory=lambda: np.array([0, NEVER_NS], np.int64))


class Link(ABC):
    """One link.

    Attributes:
        source: as the user gave it: "/dev/ttyUSB0", "sim:xbus".
        kind: name of its LinkDefinition (server/links/registry.py).
        capacity: bytes/s that the link can carry, None if unknown (a network, a file).
        baud: the rate in use, None if there is none.
        notices: permanent remarks for the page, each a sentence with its fix.
        flow: the byte flow of the link.
        speed: speed of a played file relative to the device's clock.
        detects_baud: `open` tries each rate until a protocol is detected.
        protocol: protocol of its bytes, if the link determines it; "" otherwise.
        preamble: bytes that a decoder, or a recording, needs before those that it receives from now on.
        is_simulated: a simulator makes its bytes, or made those that it plays.
        owed: frames that are owed to the device; the search for its rate ends at that rate if it is silent there.
    """

    kind: str
    is_simulated = False
    datagrams = False  # each chunk is a datagram, not divided with Flow.keep_datagrams

    def __init__(self, source: str, settings: LinkSettings) -> None:
        self.source = source
        self.settings = settings
        self.capacity: float | None = None
        self.baud: int | None = None
        self.notices: list[str] = []
        self.flow = Flow()
        self.speed = 1.0
        self.protocol = ""
        self.preamble = b""
        self.owed: OwedFrames | None = None

    @property
    def waits(self) -> bool:
        """Whether its sender can be held back without losing bytes or disturbing others."""
        return False

    @property
    def backlog(self) -> int:
        """Number of bytes that have arrived and were not read."""
        return 0

    @property
    def waiting_since_ns(self) -> int | None:
        """Arrival of the oldest bytes that were not read, ns since the Unix epoch; None if there are none, or bytes do
        not arrive by themselves (a file).
        """
        return None

    @property
    def detects_baud(self) -> bool:
        return False

    @property
    def local_path(self) -> str:
        """Path at which it is opened when it is there; "" for a network, where only an attempt shows that."""
        return ""

    @property
    def other_users(self) -> str:
        """Names of the programs that use the device beside this server; "" for none.

        While there are any, only requested data is sent: other data may interrupt what they receive.
        """
        return ""

    def other_reader(self) -> LinkError | None:
        """The error that names another program which takes bytes of this link; None without one. May take 0.1 s."""
        return None

    def fail(self, error: LinkError) -> None:
        """Make `read` end with this error, as after a lost connection, if the link supports it; it is then reopened."""
        return

    @abstractmethod
    async def open(self, progress: Progress | None = None) -> None:
        """Connect; report each attempt to `progress`.

        Raises:
            LinkError: it cannot be opened; nothing is left open behind it.
        """

    async def reopen(self, baud: int | None = None) -> None:
        """Close and open again, at another rate if given and supported.

        Raises:
            LinkError: it cannot be opened, or "refused": its rate cannot be set at this end.
        """
        if baud is not None:
            await self.check_rate(baud)
        await self.close()
        await self.open()

    def distinguish(self, others: "Iterable[Link]") -> None:  # noqa: B027 - only simulators can
        """Differ from other links of its kind, before it is opened: a simulator has a serial number of its own."""

    async def check_rate(self, baud: int) -> None:
        """Check that this end of the link supports a rate. Sets it briefly, so bytes that arrive then may be lost.

        Raises:
            LinkError: "refused": not supported.
        """
        hint = "Set it at the port that the device is connected to, then here as part of the source."
        raise LinkError("refused", f"The rate of {self.source} cannot be set from here.", hint)

    @abstractmethod
    async def read(self) -> list[Chunk]:
        """Wait for bytes and return them, oldest first, at least one chunk and about `flow.at_once` bytes.

        Raises:
            LinkError: the link has failed; all bytes received before have been returned.
        """

    def read_now(self, again_ns: int) -> list[Chunk]:
        """Return the bytes that have arrived, without waiting; may be empty.

        Args:
            again_ns: if there are any, the caller calls again after about this time, and need not be woken until then.
        """
        return []

    def follow(self) -> ReadFollower | None:
        """Let a recording take the bytes from the reading loop's memory, after all earlier ones were passed to
        `Flow.arrivals`; the one that does so already, or None if this link has no such memory. In any thread.
        """
        return None

    def unfollow(self) -> None:  # noqa: B027 - a link without such a memory has nothing to do
        """End the follower, after all its bytes were passed to `Flow.arrivals`, too."""

    @property
    def is_followed(self) -> bool:
        """Whether a recording takes the bytes that are passed to `Flow.arrivals` by itself."""
        return False

    def expect_reply(self) -> None:  # noqa: B027 - a link that wakes its reader at once has nothing to do
        """Note that an answer is expected, which must be delivered without delay."""

    def use_frames(self, frames: str, configuration: str) -> None:  # noqa: B027 - only a shared port does something
        """Find frames of a shared port, and those of clients that configure the device, with these modules
        (protocols/family/info.py: FrameFormat.frame_size, configuration_frames).
        """

    def hold_clients(self, on: bool) -> None:  # noqa: B027 - only a shared port does something
        """Let other clients of a shared port wait before they may send, while `on`."""

    @abstractmethod
    async def write(self, data: bytes) -> int | None:
        """Send all of `data`.

        Returns:
            when it was written, as Chunk.arrival_ns, if it may have waited for others; else None.

        Raises:
            LinkError: it could not be sent, or the link is read-only (a file).
        """

    @abstractmethod
    async def close(self) -> None:
        """Stop reading and free everything. Idempotent; a waiting `read` ends with LinkError "gone"."""
