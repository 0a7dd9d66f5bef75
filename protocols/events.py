"""All that comes out of a decoder.

    Batch    n samples of one message, as columns: what is plotted and recorded
    Reply    one answer or indication, with its values by name: what a dialogue waits for
    Text     one line of text in the stream (NMEA, a device's console)
    Reject   a candidate that failed its checks: counted, shown, never raised
    Gap      samples that a counter says were lost before a given one
    Step     the device clock jumped, was reset or wrapped unexpectedly

A decoder is fed chunks and drained of events. `feed` appends and is cheap; `drain` does the work on everything that is
complete. Content never raises, and the events do not depend on how the bytes were cut into chunks (their grouping into
batches may: a batch holds what one drain found).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from protocols.schema import Message

Array = NDArray[Any]


class LazyMapping(Mapping[str, Any]):
    """Values by name, read when first asked for: most answers and sentences of a busy stream are never looked at.

    Args:
        read: gives the values; called at most once.
    """

    __slots__ = ("_read", "_values")

    def __init__(self, read: Callable[[], Mapping[str, Any]]) -> None:
        self._read = read
        self._values: Mapping[str, Any] | None = None

    def _all(self) -> Mapping[str, Any]:
        if self._values is None:
            self._values = self._read()
        return self._values

    def __getitem__(self, name: str) -> Any:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def __repr__(self) -> str:
        return repr(dict(self._all()))


@dataclass(slots=True, eq=False)  # not frozen: that costs 0.4 µs each, and a live stream has one a frame
class Batch:
    """n samples of one message. To be read only.

    Args:
        message: the row; where the layout varies from frame to frame (MTData2) its `fields` are those of this layout.
        device: who sent it within the stream ("" where a stream has one device; an IDTP device id).
        arrival_ns: (n,) int64, host time of the chunk that completed each frame, ns since the Unix epoch.
        offset: (n,) int64, where each frame began in the stream, bytes.
        time_ns: (n,) int64, unwrapped device time, ns since the device's own epoch; None when there is no clock in it.
        columns: field name → array of n rows in native byte order and shown units (float64, or the wire's own integer
            or float32 type where scale is 1); records are numpy structured arrays. Computed when first asked for.
        verified: False for data whose authenticity was asked for and could not be checked.
        size: bytes of each frame on the wire, 0 where that is not known.
        header: what each frame's header says beside its payload (a timestamp as sent, a sequence number): name → (n,)
            array. Computed when first asked for.
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
    """One answer, indication or (when listening to the host's side) command: values by field name. To be read only."""

    message: Message
    values: Mapping[str, Any]
    offset: int
    size: int
    arrival_ns: int
    device: str = ""


@dataclass(frozen=True, slots=True)
class Text:
    """One line of text; `fields` where its meaning is known (an NMEA sentence's values by name)."""

    protocol: str
    name: str
    line: str
    offset: int
    size: int
    arrival_ns: int
    fields: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RejectedFrame:
    """A candidate that failed: `reason` is a word of the protocol's list ("bad_checksum", "bad_size", "truncated").

    Of a frame that is whole and yet refused, `device` is who sent it, and `detail` says why in words; "" otherwise.
    """

    offset: int
    size: int
    reason: str
    arrival_ns: int = 0
    device: str = ""
    detail: str = ""


@dataclass(frozen=True, slots=True)
class SampleGap:
    """`missing` samples were lost just before the frame at `offset` (by the counter named in `counter`)."""

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
    """What a session needs of a protocol."""

    def feed(self, data: bytes, arrival_ns: int) -> None:
        """Append a chunk. Cheap; content never raises."""

    def feed_many(self, data: bytes, ends: NDArray[np.int64], arrival_ns: NDArray[np.int64]) -> None:
        """Append many chunks that lie one after the other in `data`: (n,) where each ends, and when each arrived.

        The same as `feed` of each of them, without a call for each: an hour of a recording is half a million chunks."""

    def drain(self, *, stalled: bool = False) -> list[Event]:
        """Everything complete, in order. `stalled` says that no byte came for the stall time (or that the file ended):
        an incomplete candidate is then given up as `truncated` and the search resumes after its preamble."""

    @property
    def buffered(self) -> int:
        """Bytes held back because their frame is incomplete."""


@runtime_checkable
class Remembers(Protocol):
    """A decoder that refuses frames it has seen before, and must not forget them with a connection.

    What is remembered is the last verified number of each device of the stream.
    """

    def remembered(self) -> Mapping[int, int]:
        """Of every device with a verified frame so far."""

    def recall(self, numbers: Mapping[int, int]) -> None:
        """What an earlier decoder of the same stream remembered."""

    def rearm(self, device: str = "") -> None:
        """Accept whatever number comes next, of one device or ("") of all. For an operator to ask for."""


@dataclass(frozen=True, slots=True)
class Count:
    """How far the counter of a device has gone: which number came first and which last, modulo `modulus`, and how many
    it has gone on in between."""

    counter: str
    first: int
    last: int
    passed: int
    modulus: int


@runtime_checkable
class Counts(Protocol):
    """A decoder of a protocol whose frames are counted by the device, so that a later decoder of the same device can
    tell how many there were between the two."""

    def count_of(self, device: str = "") -> Count | None:
        """Of one device of the stream ("": the line's own); None while nothing of it was counted."""


@runtime_checkable
class Shared(Protocol):
    """A decoder of a line on which several devices may speak, each under an address of its own.

    `addresses` has that of each device that was heard, by its name in the stream ("": the line's own). Whoever
    connects again hands the same mapping to the next decoder, so that a device keeps its name whoever speaks first.
    """

    addresses: dict[str, int]


class Doubt(Protocol):
    """A setting that the stream contradicts, and why."""

    @property
    def unit(self) -> str: ...
    @property
    def reason(self) -> str: ...


@runtime_checkable
class Doubts(Decoder, Protocol):
    """A decoder whose unit of time is a setting; `contradiction` once arrival speaks for another."""

    contradiction: Doubt | None


def sender_of(event: Event) -> str:
    """Who sent it, as the stream names it; "" where nobody is named."""
    return "" if isinstance(event, Text | RejectedFrame) else event.device


def batches(events: list[Event]) -> Iterator[Batch]:
    """The batches among `events`, in order."""
    return (event for event in events if isinstance(event, Batch))
