"""Send queue of one client; drops the oldest samples when the client is slow.

    text       events, replies, channels, hello       never dropped, always first
    latest     devices, health                        only the newest of each kind is queued
    live       packets shared by all browsers         bounded: the oldest are dropped, counted per channel
    history    requested by `subscribe`               made when there is nothing else to send, newest first

Order matters twice. Text goes before samples, so that a channel is described before its first sample arrives. History
goes last, so that filling the past never delays the present.

Dropped samples are counted exactly: the next sent frame of the channel has the number dropped just before it (`dropped`
in its header), and `dropped_of` has the sums for the health report. A packet is one bytes object for all browsers; only
a frame whose count must be written is copied.

If nothing is queued and the socket accepts it at once, a packet is sent when it is offered, as a WebSocket frame made
once for all browsers: waking a task per browser and flush would cost more than everything else in a server with fifty
browsers.

This file has no task and no clock: server/api/websocket.py sends the messages.
"""

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from websockets.frames import Frame as SocketFrame
from websockets.frames import Opcode

from imuscope.server.streaming.ring_buffer import RingBuffer
from imuscope.server.wire.codec import with_dropped

# A second of 2 kHz × 10 values is 120 kB. Data queued for longer than a few seconds is no longer live, so more memory
# would only delay a slow browser further.
LIVE_BYTES = 512 * 1024
# One WebSocket message; large enough for few calls, small enough that a browser's worker stays responsive.
MESSAGE_BYTES = 128 * 1024


@dataclass(frozen=True, slots=True)
class Frame:
    """One sample frame of one channel, encoded."""

    channel: int
    n: int
    data: bytes


@dataclass(slots=True)
class Packet:
    """The frames of one flush, and the same bytes in one piece."""

    frames: tuple[Frame, ...]
    data: bytes
    at: float = 0.0  # unix s of the flush
    _ready: bytes = b""

    @staticmethod
    def of(frames: Iterable[Frame], at: float = 0.0) -> "Packet":
        stored = tuple(frames)
        return Packet(stored, b"".join([frame.data for frame in stored]), at)

    def ready(self) -> bytes:
        """The WebSocket frame (RFC 6455, 5.2) that carries it from a server, the same for every browser."""
        if not self._ready:
            self._ready = SocketFrame(Opcode.BINARY, self.data).serialize(mask=False)
        return self._ready


class HistoryStream:
    """The history requested by one subscription, divided into messages, newest first.

    Args:
        spans: channel → (ring, first and last-plus-one sequence number).
        as_sent: in the units in which they were sent, instead of the page's.
    """

    def __init__(self, spans: Mapping[int, tuple[RingBuffer, int, int]], *, as_sent: bool = False) -> None:
        self._as_sent = as_sent
        self._spans = {channel: span for channel, span in spans.items() if span[1] < span[2]}
        # Heap of (−arrival up to which the channel is still unsent, channel): the newest part is sent first.
        self._next = [(-float("inf"), channel) for channel in self._spans]
        heapq.heapify(self._next)

    def pop(self, now: float, limit: int = MESSAGE_BYTES) -> bytes | None:
        """The next message, None if everything has been sent or dropped by the rings."""
        out: list[bytes] = []
        size = 0
        while self._next and size < limit:
            _, channel = heapq.heappop(self._next)
            ring, start, stop = self._spans[channel]
            frame = ring.history_frame(channel, start, stop, now, as_sent=self._as_sent)
            if frame is None:
                continue
            began, arrival, data = frame
            out.append(data)
            size += len(data)
            if began > start:
                self._spans[channel] = (ring, start, began)
                heapq.heappush(self._next, (-arrival, channel))
        return b"".join(out) if out else None


class SendQueue:
    """Send queue of one client.

    Args:
        on_ready: called when the queue is no longer empty.
        limit: maximum size of queued live samples, bytes.
        try_send: sends a whole WebSocket frame if its socket accepts it at once, else returns False.

    Attributes:
        interval_s: shortest useful interval between samples.
        is_browser: False for a subprocess that feeds a third-party viewer.
        as_sent: samples are wanted in the units in which they were sent, instead of the page's.
    """

    interval_s = 0.0
    is_browser = True
    as_sent = False

    def __init__(
        self,
        on_ready: Callable[[], None] = lambda: None,
        limit: int = LIVE_BYTES,
        try_send: Callable[[bytes], bool] = lambda frame: False,
    ) -> None:
        self._on_ready = on_ready
        self._try_send = try_send
        self._limit = limit
        self._texts: deque[str] = deque()
        self.text_bytes = 0  # characters of queued texts
        self._latest: dict[str, str] = {}
        self._live: deque[Packet] = deque()
        self._live_bytes = 0
        self._missing: dict[int, int] = {}  # channel → dropped since its last sent frame
        self._wanted_channels: frozenset[int] | None = frozenset()  # nothing until the first subscribe
        self._history: HistoryStream | None = None
        self._after_history = ""
        self.dropped_of: dict[int, int] = {}  # channel → dropped since the browser connected
        self.number = 0  # of the browser in this run, assigned by the fan-out
        self.sent_bytes = 0
        self.sending_since: float | None = None  # start of the present transmission, unix s; set by the sender

    # ── in ──

    def put_message(self, text: str) -> None:
        """Queue a text frame that is never dropped."""
        self._texts.append(text)
        self.text_bytes += len(text)
        self._on_ready()

    def put_latest(self, kind: str, text: str) -> None:
        """Queue a text frame that replaces an unsent one of its kind."""
        self._latest[kind] = text
        self._on_ready()

    def subscribe(self, channels: Iterable[int] | None, history: HistoryStream, after_history: str) -> None:
        """Send these channels from now on (None: all). Queued samples are discarded, as on the page."""
        self._wanted_channels = None if channels is None else frozenset(channels)
        self._live.clear()
        self._live_bytes = 0
        self._missing.clear()
        self._history = history
        self._after_history = after_history
        self._on_ready()

    def offer(self, packet: Packet) -> None:
        """Send or queue live samples; above the limit, the oldest queued ones are dropped."""
        if self._wanted_channels is not None:
            frames = [frame for frame in packet.frames if frame.channel in self._wanted_channels]
            if not frames:
                return
            if len(frames) != len(packet.frames):
                packet = Packet.of(frames, packet.at)
        if not self._is_waiting and self._try_send(packet.ready()):
            self.sent_bytes += len(packet.data)
            return
        self._live.append(packet)
        self._live_bytes += len(packet.data)
        while self._live_bytes > self._limit:
            self._drop(self._live.popleft())
        self._on_ready()

    @property
    def _is_waiting(self) -> bool:
        """Whether something is queued that live samples may not overtake."""
        return bool(self._texts or self._latest or self._live or self._missing or self.sending_since is not None)

    def _drop(self, packet: Packet) -> None:
        self._live_bytes -= len(packet.data)
        for frame in packet.frames:
            self._missing[frame.channel] = self._missing.get(frame.channel, 0) + frame.n
            self.dropped_of[frame.channel] = self.dropped_of.get(frame.channel, 0) + frame.n

    def forget(self, channels: Iterable[int]) -> None:
        """Forget lost samples of channels that are gone, which no later frame can report."""
        for channel in channels:
            self._missing.pop(channel, None)

    # ── out ──

    def pop(self) -> str | bytes | None:
        """The next text or live message; None if there is none (history may still be pending)."""
        if self._texts:
            text = self._texts.popleft()
            self.text_bytes -= len(text)
            return text
        if self._latest:
            return self._latest.pop(next(iter(self._latest)))
        if not self._live:
            return None
        if len(self._live) == 1 and not self._missing:
            self._live_bytes = 0
            return self._live.popleft().data
        out: list[bytes] = []
        size = 0
        while self._live and size < MESSAGE_BYTES:
            packet = self._live.popleft()
            self._live_bytes -= len(packet.data)
            size += len(packet.data)
            out.append(self._counted(packet) if self._missing else packet.data)
        return b"".join(out)

    def _counted(self, packet: Packet) -> bytes:
        """The packet with each channel's dropped count written into its first frame since."""
        return b"".join(
            with_dropped(frame.data, self._missing.pop(frame.channel)) if frame.channel in self._missing else frame.data
            for frame in packet.frames
        )

    def take_history(self, now: float) -> bytes | None:
        """The next message of history; after the last one, `after_history` is queued."""
        if self._history is None:
            return None
        data = self._history.pop(now)
        if data is None:
            self._history = None
            self.put_message(self._after_history)
        return data

    @property
    def wants_history(self) -> bool:
        return self._history is not None

    @property
    def is_idle(self) -> bool:
        return not (self._texts or self._latest or self._live or self._history)

    @property
    def live_bytes(self) -> int:
        return self._live_bytes

    @property
    def dropped(self) -> int:
        """Samples dropped since the browser connected."""
        return sum(self.dropped_of.values())

    def lag(self, now: float) -> float:
        """Delay of this client, s: age of the oldest samples not yet accepted by its socket."""
        since = self._live[0].at if self._live else now
        return max(0.0, now - min(since, self.sending_since or now))
