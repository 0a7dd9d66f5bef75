"""What waits to be sent to one browser, and what is given up when the browser does not keep up?

    text       events, replies, channels, hello       never dropped, always first
    latest     devices, health                        only the newest of each kind waits
    live       packets shared by all browsers         bounded: the oldest are dropped, counted per channel
    history    what a `subscribe` asked for           made when there is nothing else to send, newest first

Order matters twice. Text goes before samples, so that a channel is described before its first sample arrives. History
goes last, so that filling the past never delays the present.

Dropped samples are told exactly: the next frame of the channel that does go out carries how many were dropped just
before it (`dropped` in its header), and `dropped_of` keeps the sums for the health report. A packet is one bytes object
for all browsers; only a frame whose count must be written is copied.

Where nothing waits and the socket takes it at once, a packet goes out as it is offered, as a WebSocket frame that was
made once for all browsers: waking a task per browser and flush, and what lies between it and the socket, would cost
more than all else that a server with fifty browsers does.

This file holds no task and no clock: server/api/websocket.py takes and sends.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from websockets.frames import Frame as SocketFrame
from websockets.frames import Opcode

from server.streaming.ring_buffer import RingBuffer
from server.wire_codec import with_dropped

# A second of 2 kHz × 10 values is 120 kB. What waits longer than a few seconds is not live any more, so more memory
# would only make a slow browser later, not more complete.
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
    def of(frames: Iterable[Frame], at: float = 0.0) -> Packet:
        kept = tuple(frames)
        return Packet(kept, b"".join([frame.data for frame in kept]), at)

    def ready(self) -> bytes:
        """The WebSocket frame (RFC 6455, 5.2) that carries it from a server, the same for every browser."""
        if not self._ready:
            self._ready = SocketFrame(Opcode.BINARY, self.data).serialize(mask=False)
        return self._ready


class HistoryStream:
    """The past that one subscription asked for, cut into messages newest first.

    Args:
        spans: channel → (ring, first and last-plus-one sequence number wanted).
    """

    def __init__(self, spans: Mapping[int, tuple[RingBuffer, int, int]]) -> None:
        self._spans = {channel: span for channel, span in spans.items() if span[1] < span[2]}
        # Heap of (−arrival up to which the channel is still unsent, channel): the newest stretch goes first.
        self._next = [(-float("inf"), channel) for channel in self._spans]
        heapq.heapify(self._next)

    def take(self, now: float, limit: int = MESSAGE_BYTES) -> bytes | None:
        """The next message, None when all has been sent or has meanwhile been forgotten by the rings."""
        out: list[bytes] = []
        size = 0
        while self._next and size < limit:
            _, channel = heapq.heappop(self._next)
            ring, start, stop = self._spans[channel]
            found = ring.history_frame(channel, start, stop, now)
            if found is None:
                continue
            began, arrival, data = found
            out.append(data)
            size += len(data)
            if began > start:
                self._spans[channel] = (ring, start, began)
                heapq.heappush(self._next, (-arrival, channel))
        return b"".join(out) if out else None


class SendQueue:
    """One browser's outbox.

    Args:
        on_ready: called when there is something to take where there was nothing.
        limit: bytes of live samples that may wait.
        send_now: sends a whole WebSocket frame if its socket takes it at once, else says False and does nothing.
    Attributes:
        interval_s: there is no use in offering it samples sooner after the last ones than that.
        is_browser: not a process of ours that feeds a view of another program.
    """

    interval_s = 0.0
    is_browser = True

    def __init__(
        self,
        on_ready: Callable[[], None] = lambda: None,
        limit: int = LIVE_BYTES,
        send_now: Callable[[bytes], bool] = lambda frame: False,
    ) -> None:
        self._on_ready = on_ready
        self._send_now = send_now
        self._limit = limit
        self._texts: deque[str] = deque()
        self.text_bytes = 0  # characters, of what waits
        self._latest: dict[str, str] = {}
        self._live: deque[Packet] = deque()
        self._live_bytes = 0
        self._missing: dict[int, int] = {}  # channel → dropped since its last frame that went out
        self._wanted: frozenset[int] | None = frozenset()  # nothing until the first subscribe
        self._history: HistoryStream | None = None
        self._after_history = ""
        self.dropped_of: dict[int, int] = {}  # channel → dropped since the browser connected
        self.number = 0  # of the browser in this run, given by the hub
        self.sent_bytes = 0  # and since when the message in the sender's hands has been there, unix s: by who sends
        self.sending_since: float | None = None

    # ── in ──

    def say(self, text: str) -> None:
        """A text frame that is never dropped."""
        self._texts.append(text)
        self.text_bytes += len(text)
        self._on_ready()

    def say_latest(self, kind: str, text: str) -> None:
        """A text frame that replaces an unsent one of its kind."""
        self._latest[kind] = text
        self._on_ready()

    def subscribe(self, channels: Iterable[int] | None, history: HistoryStream, after_history: str) -> None:
        """From now on these channels (None: all); first what waits is forgotten, as the page forgets it too."""
        self._wanted = None if channels is None else frozenset(channels)
        self._live.clear()
        self._live_bytes = 0
        self._missing.clear()
        self._history = history
        self._after_history = after_history
        self._on_ready()

    def offer(self, packet: Packet) -> None:
        """Live samples; drops the oldest that wait when there are too many."""
        if self._wanted is not None:
            frames = [frame for frame in packet.frames if frame.channel in self._wanted]
            if not frames:
                return
            if len(frames) != len(packet.frames):
                packet = Packet.of(frames, packet.at)
        if not self._is_waiting and self._send_now(packet.ready()):
            self.sent_bytes += len(packet.data)
            return
        self._live.append(packet)
        self._live_bytes += len(packet.data)
        while self._live_bytes > self._limit:
            self._drop(self._live.popleft())
        self._on_ready()

    @property
    def _is_waiting(self) -> bool:
        """Is there something that live samples may not overtake?"""
        return bool(self._texts or self._latest or self._live or self._missing or self.sending_since is not None)

    def _drop(self, packet: Packet) -> None:
        self._live_bytes -= len(packet.data)
        for frame in packet.frames:
            self._missing[frame.channel] = self._missing.get(frame.channel, 0) + frame.n
            self.dropped_of[frame.channel] = self.dropped_of.get(frame.channel, 0) + frame.n

    # ── out ──

    def take(self) -> str | bytes | None:
        """The next text or live message, None when there is none (history may still be wanted)."""
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
        """The next message of history; after the last one `after_history` is said."""
        if self._history is None:
            return None
        data = self._history.take(now)
        if data is None:
            self._history = None
            self.say(self._after_history)
        return data

    @property
    def wants_history(self) -> bool:
        return self._history is not None

    @property
    def idle(self) -> bool:
        return not (self._texts or self._latest or self._live or self._history)

    @property
    def live_bytes(self) -> int:
        """Bytes of live samples waiting."""
        return self._live_bytes

    @property
    def dropped(self) -> int:
        """Samples dropped since the browser connected."""
        return sum(self.dropped_of.values())

    def lag(self, now: float) -> float:
        """How far this browser is behind, s: the age of the oldest that has not been taken by its socket."""
        since = self._live[0].at if self._live else now
        return max(0.0, now - min(since, self.sending_since or now))
