"""Events: everything a decoder returns.

    Batch           n samples of one message, as columns: plotted and recorded
    Reply           one answer or indication, with its values by name: awaited by transactions
    Text            one line of text in the stream (NMEA, a device's console)
    ParsedMessage   one sentence of an embedded protocol, before it becomes a Text
    RejectedFrame   a candidate that failed its checks: counted, shown, never raised
    SampleGap       samples lost just before a given one, by a counter
    ClockStep       the device clock jumped, was reset or wrapped unexpectedly

A decoder is fed chunks and drained of events. `feed` appends and is cheap; `drain` decodes everything that is complete.
Content never raises, and the events do not depend on how the bytes were cut into chunks (their grouping into batches
may: a batch holds the result of one drain).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array
from imuscope.protocols.schema.fields import Message


class LazyMapping(Mapping[str, Any]):
    """Values by name, read on first access: most answers and sentences of a busy stream are never used.

    Args:
        read: returns the values; called at most once, with `arguments`.
    """

    __slots__ = ("_arguments", "_read", "_values")

    def __init__(self, read: Callable[..., Mapping[str, Any]], *arguments: Any) -> None:
        self._read, self._arguments = read, arguments  # no partial: that costs as much again as this object
        self._values: Mapping[str, Any] | None = None

    def _all(self) -> Mapping[str, Any]:
        if self._values is None:
            self._values = self._read(*self._arguments)
        return self._values

    def __getitem__(self, name: str) -> Any:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def __repr__(self) -> str:
        return repr(dict(self._all()))


@dataclass(slots=True, eq=False)  # not frozen: that costs 0.4 µs each, and a live stream has one per frame
class Batch:
    """n samples of one message. Read-only by convention.

    Args:
        message: the row; if the layout varies from frame to frame (MTData2) its `fields` are those of this layout.
        device: sender within the stream ("" if a stream has one device; an IDTP device id).
        arrival_ns: (n,) int64, host time of the chunk that completed each frame, ns since the Unix epoch.
        offset: (n,) int64, start of each frame in the stream, bytes.
        time_ns: (n,) int64, unwrapped device time, ns since the device's own epoch; None without a clock.
        columns: field name → array of n rows in native byte order and displayed units (float64, or the wire's own
            integer or float32 type if scale is 1); records are numpy structured arrays. Computed on first access.
        verified: False for data whose requested authenticity check was not possible.
        size: bytes of each frame on the wire, 0 if unknown.
        header: values of each frame's header beside its payload (a timestamp as sent, a sequence number): name → (n,)
            array. Computed on first access.
    """

    message: Message
    device: str
    arrival_ns: NDArray[np.int64]
    offset: NDArray[np.int64]
    time_ns: NDArray[np.int64] | None
    columns: Mapping[str, Array]
    verified: bool = True
    size: int = 0
    header: Mapping[str, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.arrival_ns)


@dataclass(slots=True)  # not frozen: see Batch
class Reply:
    """One answer, indication or (when reading the host's side) command: values by field name. Read-only by
    convention.
    """

    message: Message
    values: Mapping[str, Any]
    offset: int
    size: int
    arrival_ns: int
    device: str = ""


@dataclass(frozen=True, slots=True)
class Text:
    """One line of text; `fields` if its meaning is known (an NMEA sentence's values by name)."""

    protocol: str
    name: str
    line: str
    offset: int
    size: int
    arrival_ns: int
    fields: Mapping[str, Any] = field(default_factory=dict)


@dataclass(slots=True)
class ParsedMessage:
    """One sentence in a stretch of bytes.

    Args:
        offset, size: within the given bytes; line end included.
        protocol: "nmea" or the name of a binary string.
        name: address ("GPGGA"); "" when its check failed.
        line: the text without its line end; for a binary string, its bytes in hex.
        fields: values by name, {} if the check failed; strings "field_01"… if the meaning is unknown.
    """

    offset: int
    size: int
    protocol: str
    name: str
    line: str
    fields: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RejectedFrame:
    """A candidate that failed: `reason` is a word of the protocol's list ("bad_checksum", "bad_size", "truncated").

    For an intact but refused frame, `device` is its sender and `detail` the reason in words; "" otherwise.
    """

    offset: int
    size: int
    reason: str
    arrival_ns: int = 0
    device: str = ""
    detail: str = ""


@dataclass(frozen=True, slots=True)
class SampleGap:
    """`missing` samples were lost just before the frame at `offset` (by the counter named in `counter`).

    Negative: so many that were counted as lost before were not, because the number that showed the loss was false.
    """

    offset: int
    missing: int
    counter: str
    arrival_ns: int
    time_ns: int | None = None
    device: str = ""


@dataclass(frozen=True, slots=True)
class ClockStep:
    """The device clock did not continue: `kind` is "jump", "reset" or "sync"; `by_ns` how far it moved."""

    offset: int
    kind: str
    by_ns: int
    arrival_ns: int
    device: str = ""


Event = Batch | Reply | Text | RejectedFrame | SampleGap | ClockStep


class Decoder(Protocol):
    """Decoder interface that a session uses."""

    def feed(self, data: bytes, arrival_ns: int) -> None:
        """Append a chunk. Cheap; content never raises."""

    def feed_chunks(self, data: bytes, ends: NDArray[np.int64], arrival_ns: NDArray[np.int64]) -> None:
        """Append many consecutive chunks: (n,) end of each in `data`, and its arrival.

        Same as `feed` for each, without a call for each: an hour of a recording is half a million chunks.
        """

    def drain(self, *, stalled: bool = False) -> list[Event]:
        """Return every complete event, in order. `stalled`: no byte came for the stall time (or the file ended); an
        incomplete candidate is then given up as `truncated` and the search resumes after its preamble.
        """

    @property
    def buffered(self) -> int:
        """Bytes held back because their frame is incomplete."""


@runtime_checkable
class Remembers(Protocol):
    """A decoder that refuses frames it has seen before, and must remember them across connections.

    It stores the last verified number of each device of the stream, under a secret that the devices share: None if
    there is nothing to remember.
    """

    memory_key: bytes | None

    def state(self) -> Mapping[int, int]:
        """Replay state of every device with a verified frame so far."""

    def restore(self, numbers: Mapping[int, int]) -> None:
        """Restore the replay state of an earlier decoder of the same stream."""

    def rearm(self, device: str = "") -> None:
        """Accept any number next, of one device or ("") of all. On the operator's request."""


@dataclass(frozen=True, slots=True)
class Count:
    """Range of a device's counter: its first and last number, modulo `modulus`, and its progress between them."""

    counter: str
    first: int
    last: int
    passed: int
    modulus: int


@runtime_checkable
class Counts(Protocol):
    """A decoder of a protocol with counted frames: a later decoder of the same device can compute how many were sent
    between the two.
    """

    def count_of(self, device: str = "") -> Count | None:
        """Counter range of one device of the stream ("": the line's own); None before its first counted frame."""


@runtime_checkable
class AccountsForBytes(Protocol):
    """A decoder that counts the bytes that belong to no frame and no message that it knows."""

    @property
    def skipped(self) -> int:
        """Their number so far, those of rejected frames among them."""


@runtime_checkable
class Shared(Protocol):
    """A decoder of a line that several devices may share, each with an address of its own.

    `addresses` has the address of each device seen, by its name in the stream ("": the line's own). On reconnecting,
    pass the same mapping to the next decoder, so that a device keeps its name whichever speaks first.
    """

    addresses: dict[str, int]


class Doubt(Protocol):
    """The value of a decode option that the stream contradicts: what it concerns, a better value, and the reason."""

    @property
    def subject(self) -> str: ...
    @property
    def value(self) -> str: ...
    @property
    def reason(self) -> str: ...


@runtime_checkable
class Doubts(Decoder, Protocol):
    """A decoder with an option whose value the stream can contradict; `contradiction` is set once it does.

    `doubted` is the name of that option.
    """

    doubted: str
    contradiction: Doubt | None


@runtime_checkable
class Remarks(Protocol):
    """A decoder with remarks on its stream for the user: sentences, each with its remedy."""

    @property
    def remarks(self) -> list[str]: ...


def sender_of(event: Event) -> str:
    """Sender of an event, as named in the stream; "" without one."""
    return "" if isinstance(event, Text | RejectedFrame) else event.device


def batches(events: list[Event]) -> Iterator[Batch]:
    """The batches among `events`, in order."""
    return (event for event in events if isinstance(event, Batch))


def stream_order(event: Event) -> int:
    """Sort key of events: their position in the stream. A gap, a step or a notice precedes the frame at its offset."""
    if isinstance(event, Batch):
        return 2 * int(event.offset[0]) + 1
    return 2 * event.offset
