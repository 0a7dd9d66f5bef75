"""A link without hardware, a manual clock, and a protocol of four-byte frames."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap, Text
from imuscope.protocols.family.info import DeviceTraits
from imuscope.protocols.schema.fields import Field, Message
from imuscope.protocols.xbus.device_info import identity
from imuscope.server.devices.decode.protocol_detection import ProtocolSet
from imuscope.server.devices.device.ingest import ProtocolTraits
from imuscope.server.links.base import Attempt, Chunk, Link, LinkError, LinkSettings, Progress

NOW_NS = 1_700_000_000_000_000_000


class FakeClock:
    """Host time, moved by hand."""

    def __init__(self) -> None:
        self.ns = NOW_NS

    def __call__(self) -> float:
        return self.ns / 1e9

    def now_ns(self) -> int:
        return self.ns

    def move(self, seconds: float) -> None:
        self.ns += int(seconds * 1e9)


class FakeLink(Link):
    """Bytes, and the end of them, come from the test; `sent` keeps what is written while it `listens`."""

    kind = "serial"
    listens = False

    def __init__(self, source: str, settings: LinkSettings) -> None:
        super().__init__(source, settings)
        self.baud = 115_200
        self.capacity = 11_520.0
        self.refuses: list[LinkError] = []
        self.opened = 0
        self.sent: list[bytes] = []
        self._queue: asyncio.Queue[Chunk | Exception] = asyncio.Queue()

    async def open(self, progress: Progress | None = None) -> None:
        if progress is not None:
            progress(Attempt("115 200 Bd", "trying", self.settings.now_ns() / 1e9))
        if self.refuses:
            raise self.refuses.pop(0)
        self.opened += 1

    async def read(self) -> list[Chunk]:
        item = await self._queue.get()
        if isinstance(item, Exception):
            raise item
        return [item]

    async def write(self, data: bytes) -> None:
        if not self.listens:
            raise LinkError("gone", "nobody listens")
        self.sent.append(data)

    async def close(self) -> None:
        return

    def send(self, data: bytes, *, restart: bool = False) -> None:
        chunk = Chunk(data, self.settings.now_ns(), restart)
        self.flow.arrivals.call((chunk,))
        self._queue.put_nowait(chunk)

    def die(self, error: Exception) -> None:
        self._queue.put_nowait(error)


class TwoWayLink(FakeLink):
    listens = True


class FakeFile(TwoWayLink):
    kind = "file"


class FakeLinks(dict[str, FakeLink]):
    """Opened links by source: `open` is what a server opens its sources with."""

    def open(self, source: str, settings: LinkSettings) -> Link:
        self[source] = FakeLink(source, settings)
        return self[source]


@dataclass(frozen=True)
class FakeGuess:
    protocol: str
    score: float
    reason: str


MESSAGE = Message(
    1,
    "Sample",
    (Field("Count", "u1"), Field("Force", "i2", (1,), unit="N", axes=("x",))),
    time="Count",
    channel_per_field=True,
)
WAKE = Message(2, "WakeUp", kind="indication", title="Wake-up")


class FakeDecoder:
    """`F n lo hi`: a sample with a counter and a force; `W` wakes up; `?` is noise; a lonely `F` is incomplete.

    The device clock is 10 ms a count.

    Attributes:
        claims: beginnings of further messages, with the sizes that they claim.
    """

    claims: ClassVar[dict[bytes, int]] = {}

    def __init__(self) -> None:
        self._data = b""
        self._at = 0
        self._ends: list[tuple[int, int]] = []  # (stream offset at which a chunk ends, its arrival)
        self._count: int | None = None

    def feed(self, data: bytes, arrival_ns: int) -> None:
        self._data += data
        self._ends.append((self._at + len(self._data), arrival_ns))

    def feed_chunks(self, data: bytes, ends: NDArray[np.int64], arrival_ns: NDArray[np.int64]) -> None:
        for begin, end, arrival in zip([0, *ends[:-1].tolist()], ends.tolist(), arrival_ns.tolist(), strict=True):
            self.feed(data[begin:end], arrival)

    @property
    def _arrival(self) -> int:
        """Of the frame that starts here and has four bytes."""
        return next((arrival for end, arrival in self._ends if end >= self._at + 4), self._ends[-1][1])

    @property
    def buffered(self) -> int:
        return len(self._data)

    def drain(self, *, stalled: bool = False) -> list[Event]:
        events: list[Event] = []
        while self._data:
            head = self._data[:1]
            if len(self._data) < (4 if head == b"F" else self.claims.get(head, 0)):
                if not stalled:
                    break
                events.append(RejectedFrame(self._at, 1, "truncated", self._arrival))
                self._take(1)
            elif head == b"F":
                events += self._sample(self._data[1], int.from_bytes(self._data[2:4], "little", signed=True))
                self._take(4)
            else:
                if head == b"W":
                    values = {"product_code": "MTi-630", "device_id": 0x0380_0001}
                    events.append(Reply(WAKE, values, self._at, 1, self._arrival))
                elif head == b"$":
                    line = "$HCHDM,354.0,M*25"
                    events.append(Text("nmea", "HCHDM", line, self._at, 1, self._arrival, {"headingM": 354.0}))
                elif head == b"!":
                    raise RuntimeError("a decoder that breaks")
                else:
                    events.append(RejectedFrame(self._at, 1, "bad_checksum", self._arrival))
                self._take(1)
        return events

    def _take(self, n: int) -> None:
        self._data = self._data[n:]
        self._at += n

    def _sample(self, count: int, force: int) -> list[Event]:
        out: list[Event] = []
        if self._count is not None and count < self._count:
            out.append(ClockStep(self._at, "reset", -1_000_000, self._arrival))
        elif self._count is not None and count > self._count + 1:
            out.append(SampleGap(self._at, count - self._count - 1, "Count", self._arrival))
        self._count = count
        columns = {"Count": np.array([count], "u1"), "Force": np.array([[force]], "i2")}
        arrival = np.array([self._arrival], np.int64)
        offset = np.array([self._at], np.int64)
        return [*out, Batch(MESSAGE, "", arrival, offset, np.array([count * 10_000_000], np.int64), columns)]


def _guess(data: bytes) -> Sequence[FakeGuess]:
    share = data.count(b"F") * 4 / max(len(data), 1)
    return [FakeGuess("fake", min(share, 1.0), f"{data.count(b'F')} samples")]


SPEECH = ProtocolSet(
    decoder=lambda name, reading, link: FakeDecoder(),
    guess=_guess,
    title=lambda name: "Fake sensor",
    about=lambda name: ProtocolTraits(device=DeviceTraits(identity=identity)),
)


def sample(count: int, force: int = 0) -> bytes:
    return b"F" + bytes([count]) + force.to_bytes(2, "little", signed=True)
