"""Where do samples, events and states meet the browsers?

    session ──publish(pieces)──> Hub: a ring per channel ──flush──> one packet ──offer──> SendQueue of each browser
            ──event(…)────────>       the event log                                        …
            ──set_device(…)───>       devices, health

The hub encodes what is new once per flush and hands the same bytes to every browser. A flush happens when something has
come, at most every 8 ms for up to four browsers and every 16 ms beyond (two or one per frame of a 60 Hz screen), less
often when whoever looks needs less (`SendQueue.interval_s`), and sessions decode right before it (`on_flush`), so that
a fast device is decoded in stretches and not sample by sample.

Memory is bounded: a ring keeps at most `history_s`, all rings together at most `budget` bytes; when that is exceeded
the oldest block of all goes first, so that every channel reaches about equally far back. Events that are drawn over
samples are kept as long as these (server/streaming/event_log.py); a browser that is connected gets every event.
"""

from __future__ import annotations

import asyncio
import platform
import uuid
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.events import Batch
from server import wire, wire_codec
from server.listeners import CallbackList
from server.streaming.channels import ChannelRows
from server.streaming.event_log import EventLog
from server.streaming.ring_buffer import RingBuffer
from server.streaming.send_queue import Frame, HistoryStream, Packet, SendQueue
from server.streaming.slices import Drain, Turns
from server.streaming.unknown_payloads import Payloads
from server.version import VERSION

FEW_BROWSERS = 4
FLUSH_S = 0.008
FLUSH_MANY_S = 0.016
FLUSH_NOBODY_S = 0.1  # with nobody watching, decoding in longer stretches saves most of the work
TRIM_S = 1.0
PASSES = 8  # of the event loop between two turns that decode: as many as a request needs to be taken and answered
HISTORY_S = 600.0
BUDGET = 256 * 1024 * 1024
Dated = tuple[Batch, NDArray[np.float64], NDArray[np.float64] | None]
"""Samples, their device time on this host's clock, and their UTC where the device says it (unix s)."""


@dataclass(slots=True)
class Channel:
    """A channel and its memory; `flushed` is the sequence number up to which browsers have been offered samples."""

    info: wire.ChannelInfo
    ring: RingBuffer
    flushed: int = 0


class Hub:
    """All channels, events, device states and browsers of a server.

    Args:
        now: unix seconds that never step (server/links/base.py `steady_clock`).
    """

    tells_every_gap = False  # many in a short time are summed up (server/devices/event_reporter.py)
    keeps_clocks = False  # who looks live asks neither for a device's numbers of its clock nor for every payload

    def __init__(self, now: Callable[[], float], *, history_s: float = HISTORY_S, budget: int = BUDGET) -> None:
        self.now = now
        self.run = uuid.uuid4().hex
        self.history_s = history_s
        self.budget = budget
        self.channels: dict[int, Channel] = {}
        self.devices: dict[str, wire.DeviceInfo] = {}
        self.health: dict[str, wire.DeviceHealth] = {}
        self.raws: list[wire.RawPayload] = []
        self.log = EventLog(history_s)
        self.outboxes: set[SendQueue] = set()
        self.connected = 0  # browsers, ever
        self._attached = 0  # with views of other programs, which processes of ours feed
        self.gone_dropped = self.gone_bytes = 0  # of those that have gone
        self.recorder: wire.RecorderState | None = None
        self.exports: wire.Exports | None = None
        self.heard_event: CallbackList[[wire.EventInfo]] = CallbackList()  # who keeps what happens: a recording
        self.heard_device: CallbackList[[wire.DeviceInfo]] = CallbackList()
        self.heard_control: CallbackList[[wire.ControlState]] = CallbackList()
        self.heard_exchange: CallbackList[[wire.ExchangeEntry]] = CallbackList()
        self.heard_recorder: CallbackList[[wire.RecorderState]] = CallbackList()
        self._next_channel = 1
        self._next_event = 0
        self.controls: dict[str, wire.ControlState] = {}
        self._next_exchange = 0
        self._new_exchange: list[wire.ExchangeEntry] = []
        self._controls_changed = False
        self._touched: dict[int, Channel] = {}
        self._new_channels: list[wire.ChannelInfo] = []
        self._new_events: list[wire.EventInfo] = []
        self._devices_changed = False
        self._turns = Turns()
        self._rest_until = 0.0  # of the loop's clock: whoever waits for the loop comes first
        self._passes = 0  # of the loop, that come before the next flush
        self._timer: asyncio.Handle | None = None
        self._last_flush = 0.0
        self._next_trim = 0.0

    # ── in: from sessions ────────────────────────────────────────────────────────────────────────────────────────────

    def advertise(self, info: wire.ChannelInfo) -> int:
        """Open a channel; returns its id, which is never used again in this run."""
        channel = self._next_channel
        self._next_channel += 1
        info = replace(info, id=channel)
        self.channels[channel] = Channel(info, RingBuffer([column.dtype for column in info.columns]))
        self._new_channels.append(info)
        return channel

    def keep_clocks(self, device: str, dated: Sequence[Dated]) -> None:
        """What a device's clock said of the samples of a drain, and their UTC; asked for where `keeps_clocks`."""

    def keep_payloads(self, parts: Sequence[Payloads]) -> None:
        """Payloads of one kind that nobody has described; asked for where `keeps_clocks`."""

    def publish(self, pieces: Iterable[ChannelRows]) -> None:
        """Samples, which go out with the next flush. A channel of a removed device takes none."""
        for piece in pieces:
            channel = self.channels.get(piece.channel)
            if channel is not None and len(piece.columns[0]):
                channel.ring.append(piece.columns)
                self._touched[piece.channel] = channel

    def event(
        self,
        device: str,
        kind: wire.EventKind,
        level: wire.Level,
        text: str,
        *,
        time: float | None = None,
        span: tuple[float, float] | None = None,
        samples: int = 0,
        data: dict[str, Any] | None = None,
    ) -> wire.EventInfo:
        """Something happened: into the log, and to every browser with the next flush."""
        t0, t1 = span or (None, None)
        when = self.now() if time is None else time
        event = wire.EventInfo(self._next_event, when, device, kind, level, text, t0, t1, samples, data or {})
        self._next_event += 1
        self.log.append(event)
        self._new_events.append(event)
        self.heard_event.tell(event)
        self.request_flush()
        return event

    def set_device(self, info: wire.DeviceInfo) -> None:
        """The state of a device changed."""
        self.devices[info.id] = info
        self._devices_changed = True
        self.heard_device.tell(info)
        self.request_flush()

    def set_control(self, state: wire.ControlState) -> None:
        """What is done to a device changed."""
        self.controls[state.device] = state
        self._controls_changed = True
        self.heard_control.tell(state)
        self.request_flush()

    def set_recorder(self, state: wire.RecorderState) -> None:
        """What is being recorded changed."""
        self.recorder = state
        self.heard_recorder.tell(state)
        self._tell_latest("recorder", state)

    def set_exports(self, state: wire.Exports) -> None:
        """An export began, went on or ended."""
        self.exports = state
        self._tell_latest("exports", state)

    def library_changed(self) -> None:
        """A recording came, went or is another than it was: whoever shows the list asks for it again."""
        self._tell_latest("library", wire.LibraryChanged())

    def next_exchange(self) -> int:
        """The number of the next entry of an exchange; they are counted over all devices."""
        self._next_exchange += 1
        return self._next_exchange - 1

    def exchange(self, entry: wire.ExchangeEntry) -> None:
        """A frame sent to or received from a device. server/configuration/traffic_log.py keeps it for late browsers."""
        self._new_exchange.append(entry)
        self.heard_exchange.tell(entry)
        self.request_flush()

    def remove_device(self, device: str) -> None:
        """Forget a device with its channels and figures."""
        self.devices.pop(device, None)
        self.health.pop(device, None)
        self.log.forget(device)
        if self.controls.pop(device, None) is not None:
            self._controls_changed = True
        for channel in [number for number, one in self.channels.items() if one.info.device == device]:
            del self.channels[channel]
            self._touched.pop(channel, None)
        self._new_channels = [info for info in self._new_channels if info.device != device]
        self._devices_changed = True
        self.request_flush()

    def report_health(self, report: Iterable[wire.DeviceHealth]) -> None:
        """The figures of all devices; each browser is told its own `dropped`."""
        self.health = {health.device: health for health in report}
        shared = wire_codec.encode_text(wire.HealthReport(list(self.health.values())))
        for outbox in self.outboxes:
            own = self._health_for(outbox) if outbox.dropped_of else None
            outbox.say_latest("health", shared if own is None else wire_codec.encode_text(own))

    def report_raws(self, payloads: list[wire.RawPayload]) -> None:
        """What nobody has described, of all devices; told while there is any, and once when there is none any more."""
        if payloads or self.raws:
            self.raws = payloads
            self._tell_latest("raws", wire.Raws(payloads))

    def _health_for(self, outbox: SendQueue) -> wire.HealthReport:
        dropped: dict[str, int] = {}
        for number, count in outbox.dropped_of.items():
            if number in self.channels:
                device = self.channels[number].info.device
                dropped[device] = dropped.get(device, 0) + count
        return wire.HealthReport(
            [replace(health, dropped=dropped.get(health.device, 0)) for health in self.health.values()]
        )

    # ── flush ────────────────────────────────────────────────────────────────────────────────────────────────────────

    def on_flush(self, drain: Drain) -> Callable[[], None]:
        """Have `drain` called at the start of each flush; returns what takes it off again."""
        return self._turns.add(drain)

    @property
    def flush_interval(self) -> float:
        wished = min((outbox.interval_s for outbox in self.outboxes), default=FLUSH_NOBODY_S)
        return max(wished, FLUSH_S if len(self.outboxes) <= FEW_BROWSERS else FLUSH_MANY_S)

    def request_flush(self) -> None:
        """Flush as soon as the interval allows. To be called in the event loop; without one, call `flush` yourself."""
        if self._timer is None:
            try:
                loop = asyncio.get_running_loop()
            except RuntimeError:
                return
            due = max(loop.time(), self._last_flush + self.flush_interval, self._rest_until)
            self._timer = loop.call_at(due, self._flush_now, loop)

    def _flush_now(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._passes:
            self._passes -= 1
            self._timer = loop.call_soon(self._flush_now, loop)
            return
        self._timer = None
        self._last_flush = loop.time()
        self.flush()
        self._rest_until = loop.time() + self._turns.spent
        if self._turns.more:
            self._passes = PASSES
            self.request_flush()

    def flush(self) -> None:
        """Drain the sessions, encode what is new once, offer it to every browser."""
        self._turns.turn()
        self._flush_text()
        now = self.now()
        touched, self._touched = self._touched, {}
        frames = []
        for number, channel in touched.items():
            for n, data in channel.ring.frames(number, channel.flushed, channel.ring.total, now):
                frames.append(Frame(number, n, data))
            channel.flushed = channel.ring.total
        if frames and self.outboxes:
            packet = Packet.of(frames, now)
            for outbox in self.outboxes:
                outbox.offer(packet)
        if now >= self._next_trim:
            self._next_trim = now + TRIM_S
            self._trim(now)

    def _flush_text(self) -> None:
        if self._devices_changed:
            self._devices_changed = False
            self._tell_latest("devices", wire.Devices(list(self.devices.values())))
        if self._new_channels:
            channels, self._new_channels = self._new_channels, []
            self._tell(wire.Channels(channels))
        if self._new_events:
            events, self._new_events = self._new_events, []
            self._tell(wire.Events(events))
        if self._controls_changed:
            self._controls_changed = False
            self._tell_latest("control", wire.Control(list(self.controls.values())))
        if self._new_exchange:
            entries, self._new_exchange = self._new_exchange, []
            self._tell(wire.Exchange(entries))

    def _tell(self, message: wire.ServerText) -> None:
        if self.outboxes:
            text = wire_codec.encode_text(message)
            for outbox in self.outboxes:
                outbox.say(text)

    def _tell_latest(self, kind: str, message: wire.ServerText) -> None:
        if self.outboxes:
            text = wire_codec.encode_text(message)
            for outbox in self.outboxes:
                outbox.say_latest(kind, text)

    def _trim(self, now: float) -> None:
        rings = [channel.ring for channel in self.channels.values()]
        for ring in rings:
            ring.drop_before(now - self.history_s)
        self.log.trim(now)
        excess = sum(ring.nbytes for ring in rings) - self.budget
        while excess > 0:
            droppable = [ring for ring in rings if ring.blocks > 1]
            if not droppable:
                return
            oldest = min(droppable, key=lambda ring: ring.oldest_end)
            before = oldest.nbytes
            oldest.drop_oldest()
            excess -= before - oldest.nbytes

    # ── out: to browsers ─────────────────────────────────────────────────────────────────────────────────────────────

    def attach(self, outbox: SendQueue) -> None:
        """A browser connected: tell it all that is known. Samples begin with its `subscribe`."""
        self._flush_text()  # so that what is told now is not told again
        self._attached += 1
        outbox.number = self._attached
        self.connected += outbox.is_browser
        self.outboxes.add(outbox)
        hello = wire.Hello(VERSION, self.now(), platform.node(), self.run, self.history_s)
        outbox.say(wire_codec.encode_text(hello))
        outbox.say(wire_codec.encode_text(wire.Devices(list(self.devices.values()))))
        outbox.say(wire_codec.encode_text(wire.Channels([channel.info for channel in self.channels.values()])))
        for events in self.log.for_late():
            outbox.say(wire_codec.encode_text(wire.Events(events)))
        outbox.say(wire_codec.encode_text(wire.HealthReport(list(self.health.values()))))
        if self.controls:
            outbox.say(wire_codec.encode_text(wire.Control(list(self.controls.values()))))
        if self.recorder is not None:
            outbox.say(wire_codec.encode_text(self.recorder))
        if self.exports is not None:
            outbox.say(wire_codec.encode_text(self.exports))

    @property
    def browsers(self) -> int:
        """Those that are connected: somebody may be looking."""
        return sum(outbox.is_browser for outbox in self.outboxes)

    def detach(self, outbox: SendQueue) -> None:
        """The browser has gone."""
        if outbox in self.outboxes:
            self.outboxes.discard(outbox)
            self.gone_dropped += outbox.dropped
            self.gone_bytes += outbox.sent_bytes

    def subscribe(self, outbox: SendQueue, request: wire.Subscribe) -> None:
        """Live samples from the next flush on, and history up to exactly there."""
        since = self.now() - min(request.history, self.history_s)
        wanted = self.channels if request.channels is None else set(request.channels) & self.channels.keys()
        spans = {}
        for number in wanted:
            channel = self.channels[number]
            start = min(channel.ring.sequence_at(since), channel.flushed)
            spans[number] = (channel.ring, start, channel.flushed)
        outbox.subscribe(request.channels, HistoryStream(spans), wire_codec.encode_text(wire.Backfilled()))
